"""A smoothing kernel of one's own in a script that makes a run: the run keeps a copy of this file, and `sph restart`
goes on with it.

python examples/own_kernel.py [FOLDER], or mpirun -n 2 python -m mpi4py examples/own_kernel.py [FOLDER]
"""

import math
import sys

from mpi4py import MPI

import sph
from hpcpic.core.simd.formulas import fma, maximum
from sph.physics.smoothing import Smoothing, register


def wendland6_w(r, per_h):
    """(1 - q / 2)^8 (1 + 4 q + 25 / 4 q^2 + 4 q^3), Wendland 1995; r in m, per_h = 1 / h."""
    q = r * per_h
    far = maximum(fma(q, -0.5, 1.0), 0.0)
    square = far * far
    return (square * square) * (square * square) * fma(q, fma(q, fma(q, 4.0, 6.25), 4.0), 1.0)


def wendland6_f(r, per_h):
    """Its derivative by q, over q and -5.5: (1 - q / 2)^7 (1 + 7 / 2 q + 4 q^2)."""
    q = r * per_h
    far = maximum(fma(q, -0.5, 1.0), 0.0)
    square = far * far
    return (square * square) * (square * far) * fma(q, fma(q, 4.0, 3.5), 1.0)


norm = {2: 78 / (28 * math.pi), 3: 1365 / (512 * math.pi)}
register(Smoothing("wendland6", support=2.0, norm=norm, w=wendland6_w, f=wendland6_f, slope=-5.5))

if __name__ == "__main__":
    folder = sys.argv[1] if len(sys.argv) > 1 else "runs/own-kernel"
    case = sph.Case("water-column").changed(
        {"numerics.kernel": "wendland6", "numerics.spacing": 0.02, "simulation.cfl": 0.3, "simulation.end_time": 0.02}
    )
    run = case.run(folder, threads=1, quiet=True)
    if MPI.COMM_WORLD.rank == 0:
        print(run.digest)
