"""Gauges that remember when they were read are read when a run would have: looking at a simulation changes nothing."""

import pytest

import sph

GAUGES = {
    "mean": {"name": "read", "what": "wall-pressure", "at": [0.05, 0.0], "axis": "y-", "size": [0.06, 0.0]},
    "period": {"name": "read", "what": "elevation", "at": [0.1, 0.0], "period": 0.03},
}


@pytest.mark.parametrize("gauge", GAUGES.values(), ids=GAUGES)
def test_a_simulation_that_is_looked_at_or_not_goes_on_as_the_run(gauge, tmp_path):
    case = sph.Case("water-column").changed(
        {"numerics.spacing": 0.02, "simulation.end_time": 0.1, "output.period.series": 0.02, "gauge": [gauge]}
    )
    run = case.run(tmp_path / "run", threads=1, quiet=True)
    seen = {}

    def look(sim):
        seen[sim.iteration] = sim.scalars().get("read")

    for looks in (False, True):
        with case.simulation(threads=1) as sim:
            if looks:
                sim.every(steps=1)(look)
            sim.advance()
            assert sim.digest() == run.digest
    if "size" in gauge:  # at the times of the series the values of the series: means since its last sample
        assert [seen[int(step)] for step in run.series.step] == run.series["read"].values.tolist()
        assert len(seen) > len(run.series.step)
