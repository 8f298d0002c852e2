"""A wall rule of the lattice of one's own: that of Yu, Mei & Shyy (AIAA 2003-0953), for walls and grains alike.

python examples/own_wall_rule.py, or lbmdem run CASE --set coupling.bounce_back=unified --use examples/own_wall_rule.py
"""

import numpy as np

import lbmdem
from lbmdem.physics.wall_rules import register


def unified(q, gi_x, gi_y, gj_x, push):
    """What comes back to the node x, by populations of x and of y behind it; the wall is at q of the link."""
    at_wall = q * gi_x + (1.0 - q) * gi_y - push
    return (at_wall + q * gj_x) / (1.0 + q)


register("unified", unified)

if __name__ == "__main__":
    # a plate slides at 0.1 mm/s over one at rest between two rows of nodes
    with lbmdem.Case("couette").changed({"coupling.bounce_back": "unified"}).simulation(threads=1) as sim:
        sim.advance()
        velocity, digest, rank = sim.fields("velocity"), sim.digest(), sim.rank
    if rank == 0:
        y = velocity.y.values
        straight = np.clip(1e-4 * (y - 1.1e-4) / (1e-3 - 1.1e-4), 0.0, None)
        off = np.abs(velocity.sel(component="x") - straight[:, None]).max() / 1e-4
        print(f"off the straight line between the plates by {float(off):.1g} of the largest velocity")
        print(digest)
