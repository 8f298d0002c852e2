"""Gauges: exact for linear fields, means of planes and boxes, the same bits for any cuts."""

import numpy as np
import pytest

from hpcpic.core.case.columns import joined
from hpcpic.core.case.gauge import Gauge, gauge_columns, gauge_faults, named
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.arrays import FieldArray
from hpcpic.core.run.gauges import Gauges, axis_weights
from hpcpic.core.space.domain import Domain, even_cuts

LENGTHS = (2.0, 3.0)  # x, y
POINTS = (8, 12)
UNITS = {"u": ("m/s", 2), "p": ("Pa", 0)}


def domain(world: World, offset: float = 0.5, periodic: bool = False) -> Domain:
    cuts = even_cuts(POINTS[1], world.size)
    return Domain(LENGTHS[::-1], POINTS[::-1], (periodic,) * 2, cuts, offset)


def fields(of: Domain, rank: int) -> dict[str, FieldArray]:
    """u = (1 + x + 2 y, x y), p = 3 x - y, at the nodes of a rank."""
    low, high = of.row_range(rank)
    y = (np.arange(low, high)[:, None] + of.offset) * of.spacing[0]
    x = (np.arange(POINTS[0])[None, :] + of.offset) * of.spacing[1]
    return {"u": FieldArray(np.stack([1 + x + 2 * y, x * y], axis=-1), "m/s"), "p": FieldArray(3 * x - y, "Pa")}


def read(*gauges: Gauge) -> dict[str, float]:
    world = World.start()
    of = domain(world)
    return Gauges(named(gauges), of, world).values(fields(of, world.rank))


def test_weights_are_those_of_the_mean_of_the_line_through_the_nodes():
    rng = np.random.default_rng(1)
    for periodic in (False, True):
        for offset in (0.0, 0.5):
            low, high = np.sort(rng.uniform(0, 9, 2))
            weights = axis_weights(9, offset, periodic, low, high)
            nodes, values = np.arange(9) + offset, rng.normal(size=9)
            x = np.linspace(low, high, 20001)
            middle = (x[1:] + x[:-1]) / 2
            line = np.interp(middle, nodes, values, period=9 if periodic else None)
            assert weights @ values == pytest.approx(line.mean(), abs=1e-6)  # midpoints: error of second order
            at = axis_weights(9, offset, periodic, low, low)
            assert at @ values == pytest.approx(float(np.interp(low, nodes, values, period=9 if periodic else None)))
            assert weights.sum() == pytest.approx(1, rel=1e-14)


def test_linear_fields_are_read_exactly_at_points_and_on_lines_and_boxes():
    values = read(
        Gauge(name="a", what="u", at=(0.7, 1.1)),
        Gauge(what="u", at=(1.0, 1.5), size=(1.2, 0.0)),
        Gauge(what="p", at=(1.0, 1.5), size=(1.0, 2.0)),
    )
    assert values["a_x"] == pytest.approx(1 + 0.7 + 2.2, rel=1e-13)
    assert values["a_y"] == pytest.approx(0.77, rel=1e-13)  # bilinear
    assert values["gauge_2_x"] == pytest.approx(5.0, rel=1e-13)
    assert values["gauge_3"] == pytest.approx(1.5, rel=1e-13)


def test_extremes_are_those_of_the_nodes():
    low, high = read(
        *(Gauge(what="p", at=(1.0, 1.5), size=LENGTHS, take=take) for take in ("minimum", "maximum"))
    ).values()
    assert (low, high) == (3 * 0.125 - 2.875, 3 * 1.875 - 0.125)


@pytest.mark.mpi(min_size=2)
def test_readings_do_not_depend_on_the_cuts():
    gauge = Gauge(name="g", what="u", at=(1.0, 1.5), size=(1.9, 2.7))
    whole = domain(World.alone())
    alone = Gauges([gauge], whole, World.alone()).values(fields(whole, 0))
    assert read(gauge) == alone


def test_only_nodes_that_hold_a_value_count():
    world = World.start()
    of = domain(world)
    gauges = Gauges(
        named([Gauge(what="p", at=(1.0, 1.5), size=LENGTHS, take=take) for take in ("mean", "maximum")]), of, world
    )
    values = fields(of, world.rank)
    x = values["u"].values[..., 0] - 1
    none, left = np.zeros(x.shape, bool), np.zeros(x.shape, bool)
    left[:, :2] = True
    mean, most = gauges.values(values, left).values()
    assert mean == pytest.approx(3 * 0.25 - 1.5, rel=1e-13)
    assert most == 3 * 0.375 - 0.125
    assert all(np.isnan(value) for value in gauges.values(values, none).values())


def test_faults_name_the_gauge_and_what_would_be_right():
    bad = [
        Gauge(what="v", at=(1.0, 1.0)),
        Gauge(what="p", at=(1.0,)),
        Gauge(what="p", at=(1.0, 4.0)),
        Gauge(what="p", at=(1.0, 1.0), size=(3.0, 0.0)),
        Gauge(name="gauge_1", what="p", at=(1.0, 1.0)),
        Gauge(name="gauge_1", what="p", at=(1.0, 1.0)),
    ]
    faults = list(gauge_faults(bad, UNITS, LENGTHS))
    assert [path for path, _ in faults] == [
        ("gauge", 0, "what"), ("gauge", 1, "at"), ("gauge", 2, "at"), ("gauge", 3, "size"), ("gauge", 5, "name"),
    ]  # fmt: skip
    assert not list(gauge_faults([Gauge(what="u", at=(0.0, 3.0))], UNITS, LENGTHS))


@pytest.mark.parametrize("name, what, n", [("time", "p", 1), ("step", "p", 1), ("time", "u", 0), ("times", "p", 0)])
def test_a_gauge_is_not_called_as_the_columns_that_tell_when(name, what, n):
    faults = list(gauge_faults([Gauge(name=name, what=what, at=(1.0, 1.0))], UNITS, LENGTHS))
    assert [path for path, _ in faults] == [("gauge", 0, "name")] * n


def test_a_column_of_the_series_is_not_overwritten():
    gauges = gauge_columns([Gauge(name="mass", what="p", at=(1.0, 1.0))], UNITS)
    with pytest.raises(ConfigError, match="the scene has a column mass, and gauge 'mass' too: name gauge 'mass' other"):
        joined([("the scene", {"mass": "kg"}), *gauges])
