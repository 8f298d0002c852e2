"""Read a run with xarray: series, a field on its grid, grains.

python examples/read_a_run.py [FOLDER]
"""

import sys

import lbmdem

folder = sys.argv[1] if len(sys.argv) > 1 else "runs/disc"
case = lbmdem.Case("settling-disc").changed(
    {"simulation.end_time": 0.02, "output.period.fields": 0.01, "output.period.grains": 0.01}
)
case.run(folder, threads=1, quiet=True)

run = lbmdem.open_run(folder)  # also of a run that another machine made, that is under way, or that was killed
print(run)
print(run.series.to_dataframe().describe())
velocity = run.fields("velocity", time=0.01)
print(velocity.sel(component="y").min().item(), velocity.attrs["units"])
print(velocity.sel(x=slice(0.0, 0.005)).mean("x"))
print(run.particles()["position"])
