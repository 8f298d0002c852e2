"""A wall rule of the lattice of one's own: that of Yu, Mei & Shyy (AIAA 2003-0953), for walls and grains alike.

python examples/own_wall_rule.py, or lbmdem run CASE --set coupling.bounce_back=unified --use examples/own_wall_rule.py
"""

import lbmdem
from lbmdem.physics.wall_rules import register


def unified(q, gi_x, gi_y, gj_x, push):
    """What comes back to the node x, by populations of x and of y behind it; the wall is at q of the link."""
    at_wall = q * gi_x + (1.0 - q) * gi_y - push
    return (at_wall + q * gj_x) / (1.0 + q)


register("unified", unified)

if __name__ == "__main__":
    short = {"simulation.end_time": 0.01, "coupling.bounce_back": "unified"}
    with lbmdem.Case("settling-disc").changed(short).simulation(threads=1) as sim:
        sim.advance()
        fall, digest, rank = float(sim.particles()["velocity"][0, 1]), sim.digest(), sim.rank
    if rank == 0:
        print(f"the disc falls at {-fall:.4g} m/s")
        print(digest)
