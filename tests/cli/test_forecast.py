"""Laws of what estimates are made of."""

from itertools import pairwise

import pytest

from hpcpic.core.cli.forecast import gain, writing_seconds
from hpcpic.core.cli.rates import undisturbed


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
