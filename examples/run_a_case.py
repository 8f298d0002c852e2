"""Run a shipped case, look at its series, draw a figure.

python examples/run_a_case.py [FOLDER], or mpirun -n 2 python -m mpi4py examples/run_a_case.py [FOLDER]: all ranks take
part, and the state at the end is the same, bit for bit.
"""

import sys

from mpi4py import MPI

import hpcpic

folder = sys.argv[1] if len(sys.argv) > 1 else "runs/oscillation"
case = hpcpic.Case("plasma-oscillation").changed({"simulation.cycles": 200})
run = case.run(folder, threads=1, quiet=True)

if MPI.COMM_WORLD.rank == 0:
    print(case.check()["wp dt"])
    energy = run.series["energy_field"]  # an xarray.DataArray over time
    print(f"field energy {float(energy[0]):.3g} J at the start, {float(energy.min()):.3g} J at the least")
    print(run.digest)
    run.plot("energies").savefig(run.path / "energies.png")
