"""Time of a field by LU and by MFT on N x N points, one core, and of the factors of LU: a table and its figure.

    python benchmarks/solvers.py [16,32,64,128,256] [--figure docs/gallery/solvers.png]

The thesis (5.2) has both: LU takes the factors of a sparse matrix once and two triangular solves a step, MFT two
transforms. Solves are measured in turn, round after round; the best counts.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from hpcpic.core.app import figures
from hpcpic.core.app.rates import in_turn
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from hpcpic.plasma.physics.poisson import LU, MFT

ROUNDS = 20
FIGURE = Path(__file__).parents[1] / "docs/gallery/solvers.png"


def measured(n: int) -> tuple[float, float, float]:
    """Seconds of the factors of LU, of a solve by LU, and of one by MFT."""
    world, pool = World.alone(), Pool(1)
    place = Domain((1.0, 1.0), (n, n), (True, True), (0, n))
    start = time.perf_counter()
    solvers: dict[str, LU | MFT] = {"LU": LU(world, pool, place)}
    factors = time.perf_counter() - start
    solvers["MFT"] = MFT(world, pool, place)
    for solver in solvers.values():
        solver.rho[:] = np.random.default_rng(1).standard_normal(solver.rho.shape)
        solver.solve()
    misfit = np.abs(solvers["LU"].phi - solvers["MFT"].phi).max() / np.abs(solvers["MFT"].phi).max()
    assert misfit < 1e-9, f"LU and MFT differ by {misfit:g}"
    seconds = in_turn({name: solver.solve for name, solver in solvers.items()}, rounds=ROUNDS)
    for solver in solvers.values():
        solver.free()
    pool.close()
    return factors, seconds["LU"], seconds["MFT"]


def drawn(sizes: list[int], rows: list[tuple[float, float, float]], path: Path) -> None:
    with figures.style():
        figure, axes = figures.new_figure()
        for name, values in zip(("factors of LU, once", "LU, a step", "MFT, a step"), zip(*rows)):
            axes.loglog(sizes, np.array(values) * 1e3, marker="o", label=name)
        axes.set(xlabel="points on an axis", ylabel="time, ms", title="A field of N x N points, one core")
        axes.set_xticks(sizes, [str(n) for n in sizes])
        axes.minorticks_off()
        axes.legend()
        figure.savefig(path, dpi=84, facecolor=figures.PAPER)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="?", default="16,32,64,128,256")
    parser.add_argument("--figure", type=Path, default=FIGURE)
    options = parser.parse_args()
    sizes = [int(n) for n in options.sizes.split(",")]
    print("N x N   factors, ms   LU, us   MFT, us   LU/MFT")
    measured(8)  # imports and compiles
    rows = []
    for n in sizes:
        factors, lu, mft = measured(n)
        rows.append((factors, lu, mft))
        print(f"{n:5d}   {1e3 * factors:11.1f}   {1e6 * lu:6.0f}   {1e6 * mft:7.1f}   {lu / mft:6.1f}", flush=True)
    drawn(sizes, rows, options.figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
