"""Laws of `bench`: what it measures is what `estimate` asks for, alone and on several ranks."""

import math
from importlib import import_module

import pytest

from hpcpic.core.app.rates import in_turn
from hpcpic.core.cli.bench import _kernel_rows

PROGRAMS = ("hpcpic.plasma", "sph", "lbmdem")


def test_actions_take_turns_and_the_first_call_of_a_turn_does_not_count(monkeypatch):
    order, clock = [], [0.0]
    monkeypatch.setattr("hpcpic.core.app.rates.perf_counter", lambda: clock[0])

    def action(name, seconds):
        def call():
            first = not order or order[-1] != name
            order.append(name)
            clock[0] += 100.0 * seconds if first else seconds

        return call

    found = in_turn({"a": action("a", 1.0), "b": action("b", 3.0)}, rounds=2, calls=3)
    assert "".join(order) == "aaabbbaaabbb"
    assert found == {"a": 1.0, "b": 3.0}


def test_the_fraction_of_the_memory_bound_is_told_where_bytes_are():
    rates = {"a_ns": 4.0, "a_bytes": 10.0, "mlups D double": 50.0, "mlups_bytes D double": 80.0, "b_ns": 4.0, "n": 2.0}
    rows = _kernel_rows(rates, 5e9)  # 2 ns for 10 bytes, 16 ns for 80
    shares = {name: part for name, _, part in rows}
    assert shares == {"a_ns": "50%", "mlups D double": "80%", "b_ns": "", "n": ""}


def checked(module, rates):
    default = import_module(f"{module}.forecast.estimate").DEFAULT
    assert rates and {name for name in rates if "_bytes" not in name} <= set(default)
    assert all(math.isfinite(rate) and rate >= 0.0 for rate in rates.values())


@pytest.mark.validation
@pytest.mark.parametrize("module", PROGRAMS)
def test_estimate_knows_every_rate_of_a_quick_bench(module):
    checked(module, import_module(f"{module}.bench").bench(True))


@pytest.mark.validation
@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("module", PROGRAMS)
def test_estimate_knows_every_rate_of_several_ranks(module, world):
    checked(module, import_module(f"{module}.bench").bench_ranks(True, world))
