"""Laws of what estimates are made of."""

import re
from importlib import import_module
from itertools import pairwise

import pytest

from hpcpic.core.app.forecast import gain, writing_seconds
from hpcpic.core.app.rates import undisturbed, usual
from hpcpic.core.app.read import read_case
from hpcpic.core.cli.check import late_outputs, whole_run


@pytest.mark.parametrize("cores", [1, 2, 8])
def test_more_cores_never_take_longer_and_a_node_gains_what_was_measured(cores):
    rates = {"cores": float(cores)}
    gains = [gain(n, 1, rates, 0.8 * cores + 0.2) for n in range(1, 4 * cores)]
    assert gains[0] == 1.0 and gains[cores - 1] == pytest.approx(0.8 * cores + 0.2)
    assert all(after >= before for before, after in pairwise(gains))
    assert gain(1, cores, rates, 1.5) == gain(cores, 1, rates, 1.5)


def test_no_gain_is_more_than_there_are_cores_or_less_than_one():
    rates = {"cores": 2.0}
    assert gain(1, 2, rates, 2.7) == 2.0 and gain(1, 2, rates, 0.7) == 1.0


def test_nodes_of_the_same_kind_add_up():
    rates = {"cores": 4.0}
    assert gain(40, 1, rates, 3.0) == pytest.approx(10 * 3.0)


def test_files_cost_their_bytes_and_a_price_each():
    rates = {"disk_gb_s": 0.5, "snapshot_ms": 2.0}
    assert writing_seconds({"fields": 1e9, "series": 0.5e9}, 3, rates) == pytest.approx(3.0 + 0.006)


def test_a_disturbed_measurement_does_not_count():
    assert undisturbed([1.0, 1.0, 1.0, 50.0, 80.0]) == 1.0


@pytest.mark.parametrize(
    ("program", "case", "endless"),
    [("hpcpic", "landau-damping", "simulation.cycles=4000000000000000L"),
     ("sph", "hydrostatic", "simulation.end_time=1e15"), ("lbmdem", "poiseuille", "simulation.end_time=1e15")],
)  # fmt: skip
def test_a_run_that_nobody_can_wait_for_is_told_with_what_a_day_is_enough_for(program, case, endless):
    app = import_module(f"{program}.__main__").load_app()
    told = [whole_run(app, read_case(app, case, sets).config, 1) for sets in ((), (endless,))]
    assert [number.verdict for number in told] == ["ok", "warn"]
    key = endless.partition("=")[0]
    assert told[1].key == tuple(key.split(".")) and " steps; " in told[1].cure
    enough = re.search(rf"{key} = \S+", told[1].cure)[0].replace(" ", "")
    assert whole_run(app, read_case(app, case, (enough,)).config, 1).value == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("program, period, cure", [
    ("sph", "output.period.series=1e3", "output.period.series = "),
    ("sph", "output.every.particles=2000000000", "output.every.particles = "),
    ("sph", "output.period.checkpoint=1e3", ""),  # there is one at the end
    ("lbmdem", "output.period.fields=1e3", "output.period.fields = "),
    ("hpcpic.plasma", "output.every.fields=2000000000", "output.every.fields = "),
])  # fmt: skip
def test_outputs_that_begin_after_the_end_are_told(program, period, cure):
    app = import_module(f"{program}.app").APP
    case = str(next(iter(app.cases().values())))
    assert not list(late_outputs(app, read_case(app, case, ()).config))
    told = list(late_outputs(app, read_case(app, case, (period,)).config))
    assert [number.verdict for number in told] == ["warn"] * bool(cure)
    for number in told:
        assert number.cure.startswith(cure)
        config = read_case(app, case, (number.cure.replace(" ", ""),)).config
        assert not list(late_outputs(app, config))


@pytest.mark.parametrize("program", ["hpcpic.plasma", "sph", "lbmdem"])
@pytest.mark.parametrize("masks", [True, False])
def test_a_machine_that_nobody_measured_has_the_rates_of_its_kind(program, masks, monkeypatch):
    """Without AVX-512 a vector takes two instructions: nothing is faster, but for what is beside a vector."""
    monkeypatch.setattr("hpcpic.core.app.rates.has_masks", lambda: masks)
    known = import_module(f"{program}.forecast.estimate")
    rates = usual(known.DEFAULT, known.NARROW)
    assert set(rates) == set(known.DEFAULT) and set(known.NARROW) < set(known.DEFAULT)
    assert (rates == known.DEFAULT) == masks
    for name, rate in known.DEFAULT.items():
        assert not name.startswith(("pair_ns", "particle_ns")) or rates[name] >= rate
        assert not name.startswith("mlups") or rates[name] <= rate
