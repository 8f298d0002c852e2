"""Walls that meet only along an edge let fluid out, and are told; those that overlap do not."""

import pytest
from sph_scenes import config, engine, text

from sph.forecast.joints import joints
from sph.setup.scene import Scene

DP = 0.05
NAMES = [f"overlap of {a} and {b}, which meet only at an edge" for a, b in (("sides", "floor"), ("floor", "sides"))]


def walls(d=2, down=0.0, wide=0.0, kind="extrapolated-free-slip"):
    """Sides that end so many m under the top of a floor, which is so much wider than they are."""
    box = '{ shape = { box = { low = %s; high = %s; %s }; }; type = "%s"; name = "%s"; %s }'
    ends = f'open = ["{"xyz"[d - 1]}-", "{"xyz"[d - 1]}+"];'
    sides = box % ([0.0] * (d - 1) + [-down], [1.0] * d, ends, kind, "sides", "")
    low, high = [-wide] * (d - 1) + [-0.3], [1.0 + wide] * (d - 1) + [0.0]
    return f"( {sides}, {box % (low, high, '', kind, 'floor', 'solid = true;')} )"


def case(given, d=2, **settings):
    whole = text(d=d, fill=[1.0] * (d - 1) + [0.4], spacing=DP, more=f"wall = {given};", **settings)
    low = [0.0 if axis in settings.get("periodic", ()) else -0.5 for axis in "xyz"[:d]]
    return whole.replace(f"domain = {{ low = {[0.0] * d}", f"domain = {{ low = {low}")


def rows(given, d=2, **settings):
    return [row.name for row in joints(Scene(config(case(given, d, **settings))))]


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("made, tells", [
    ({}, True),
    ({"down": 0.2 * DP}, True),  # hardly
    ({"down": -0.2 * DP}, True),  # and a gap
    ({"down": DP}, False),
    ({"wide": DP}, False),
    ({"kind": "pressure-continuity"}, False),  # that hold
])  # fmt: skip
def test_walls_that_meet_only_at_an_edge_are_told(d, made, tells):
    found = rows(walls(d, **made), d)
    assert len(found) == tells and set(found) <= set(NAMES)


def test_an_edge_that_no_fluid_sees_or_that_goes_through_a_period_is_not_told():
    step = '{ name = "step"; solid = true; shape = { box = { low = [1.5, 0.0]; high = [1.8, 0.3]; }; }; }'
    assert rows(walls(wide=0.5)[:-1] + f", {step} )") == []
    lid = step.replace("step", "lid").replace("[1.5, 0.0]; high = [1.8, 0.3]", "[0.6, 1.0]; high = [1.0, 1.3]")
    assert rows(walls(wide=0.5)[:-1] + f", {lid} )") == [NAMES[0].replace("floor", "lid")]
    assert rows(walls(), periodic=("x",)) == []


@pytest.mark.parametrize("made, lost", [({}, True), ({"down": DP}, False), ({"wide": DP}, False)])
def test_they_leak_and_the_cure_holds(made, lost):
    sph = engine(case=case(walls(**made)))
    while sph.time < 1.0:
        sph.step()
    below = sph.storage.physical("x", sph.storage.fluid_slots)[:, 1] < -DP
    assert bool(below.any()) == lost
