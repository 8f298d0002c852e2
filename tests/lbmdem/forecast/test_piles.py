"""What check tells of the weight below piles, columns and beds: that of the grains above, whatever the floor."""

import math

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.physics.contact_law import deepest_overlap
from lbmdem.case.config import contact_law
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived

DRY = """
simulation = { end_time = 0.3; };
domain = { size = [WIDE, 0.04]; };
grains = ({ density = 2500.0; diameter = 1.0e-3; position = (PLACES); });
contact = { normal_stiffness = 4000.0; };
gravity = [0.0, -9.81];
"""
WEIGHT = 2500.0 * math.pi / 4.0 * 1e-6 * 9.81 / 4000.0 / 1e-3  # of a disc: its overlap over its diameter


def told(text, name="overlap at rest", *sets):
    return next((one for one in derived(configure(loads(text, sets=sets))) if one.name == name), None)


def dry(places, wide=0.03):
    return DRY.replace("WIDE", str(wide)).replace("PLACES", ", ".join(map(str, places)))


def hexagonal(across, high, left=0.0, d=1.0e-3):
    """Rows of discs of d, each above the gaps of the one below."""
    rise = 0.5 * math.sqrt(3.0) * d * 1.001
    return [[left + d * (i + 0.5 + 0.5 * (k % 2)), 0.5 * d + rise * k] for k in range(high) for i in range(across)]


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("pull, density", [(-9.81, 0.0), (9.81, 0.0), (-9.81, 4000.0)])
def test_the_lowest_of_a_stack_bears_all_of_it(dimensions, pull, density):
    """Also upside down, and where a fluid lifts it."""
    aside = dimensions - 1
    text = dry([[0.01] * aside + [1e-3 * (k + 0.5)] for k in range(10)])
    text = text.replace("[0.03, 0.04]", str([0.02] * dimensions)).replace("[0.0, -9.81]", str([0.0] * aside + [pull]))
    if density:
        text = text.replace("02]; }", "02]; spacing = 1.0e-4; }")
        text += f"fluid = {{ density = {density}; kinematic_viscosity = 1.0e-5; }};"
    volume = math.pi / 4.0 * 1e-6 if dimensions == 2 else math.pi / 6.0 * 1e-9
    rest = 10.0 * abs(2500.0 - density) * volume * 9.81 / 4000.0 / 1e-3
    assert told(text).value == pytest.approx(rest, rel=1e-9) and "10 grains that stand" in told(text).source


def test_a_column_of_discs_bears_its_height_on_any_floor():
    """Five discs across and ten high: not the 1.6 layers of all of them over a floor of 30 diameters."""
    narrow, wide = (told(dry(hexagonal(5, 10, 0.005), size)).value for size in (0.02, 0.2))
    assert narrow == wide == pytest.approx(10.0 * WEIGHT, rel=0.03)
    assert told(dry(hexagonal(5, 10, 0.005)), "deepest overlap at rest").value == pytest.approx(4.0 * narrow)


def test_below_a_wide_even_bed_lies_what_its_layers_weigh():
    """Of 29 discs a row in their densest order, and loosely in none."""
    rng, places = np.random.default_rng(3), np.zeros((0, 2))
    for x in np.column_stack([rng.uniform(5e-4, 0.0295, 10_000), np.linspace(5e-4, 0.012, 10_000)]):
        if ((places[-60:] - x) ** 2).sum(axis=1).min(initial=1.0) > 1.02e-6:
            places = np.vstack([places, x])
    for bed in (hexagonal(29, 10), places.tolist()):
        even = len(bed) * math.pi / 4.0 * 1e-6 / (0.03 * 0.8 * 1e-3) * WEIGHT
        assert told(dry(bed)).value == pytest.approx(even, rel=1e-9) and "in the mean" in told(dry(bed)).source


def test_grains_apart_do_not_stand_on_each_other():
    """Those that fall from far above each other settle side by side."""
    places = [[0.015, 5e-4 + 2e-3 * k] for k in range(10)]
    assert told(dry(places)).value == pytest.approx(WEIGHT, rel=1e-9)


def test_a_packing_between_planes_lies_on_what_they_leave_of_the_floor():
    """As high as between the sides of a box that is as narrow."""
    packed = "diameters = { min = 0.9e-3; max = 1.1e-3; count = 200; }; packing = { low = 0.0; };"
    text = DRY.replace("diameter = 1.0e-3; position = (PLACES);", packed)
    planes = (f"{{ shape = {{ plane = {{ point = [{x}, 0.0]; normal = [{way}, 0.0]; }}; }}; }}"
              for x, way in ((0.01, 1.0), (0.02, -1.0)))  # fmt: skip
    between = text.replace("WIDE", "0.03") + f"obstacle = ({', '.join(planes)});"
    assert told(between).value == pytest.approx(told(text.replace("WIDE", "0.01")).value, rel=1e-9)
    assert told(between).value == pytest.approx(3.0 * told(text.replace("WIDE", "0.03")).value, rel=1e-9)


def test_a_stack_that_runs_overlaps_as_told(world):
    """Five discs in a column that sides hold."""
    places = [[5e-4, 1e-3 * (k + 0.5)] for k in range(5)]
    text = dry(places, 0.001).replace("4000.0;", "4.0e4; damping = 0.7; friction = 0.0;")
    with running(world, "lbmdem", text) as app:
        while app.time < 0.02:
            app.step()
        assert app.scalars()["overlap"] == pytest.approx(told(text).value, rel=0.01)


def test_grains_of_a_bed_fall_no_further_than_its_lowest_and_those_of_a_column_onto_what_it_leaves():
    """A bed at rest between walls was refused for a fall from its top; a column in a wider box does collapse, onto the
    layer that the rows below its top make of the floor. Layers as dense land undamped."""
    places, name = hexagonal(10, 20), "overlap at impact"
    law, mass = contact_law(configure(loads(dry(places)))), 2500.0 * math.pi / 4.0 * 1e-6

    def deep(fall, law=law):
        return pytest.approx(deepest_overlap(math.sqrt(2.0 * 9.81 * fall), mass, law) / 1e-3, rel=1e-9)

    assert told(dry(places, wide=0.0105), name) is None
    left = 190 * math.pi / 4.0 * 1e-6 / 0.8 / 0.03
    assert told(dry(places, wide=0.03), name).value == deep(max(y for _, y in places) - 5e-4 - left)
    lifted = [[x, y + 5e-3] for x, y in places]
    assert told(dry(lifted, wide=0.0105), name).value == deep(5e-3, law._replace(damping=0.0))


LOOSE = "diameters = { min = 0.9e-3; max = 1.1e-3; count = 20; }; packing = { porosity = 0.8; }"


def test_a_loose_packing_lands_less_deep_than_told(world):
    """Its top falls on while those below it settle, which was told as no fall at all."""
    text = dry([]).replace("diameter = 1.0e-3; position = ()", LOOSE)
    text = text.replace("0.03", "0.0105").replace("4000.0", "1.0e5")
    assert 0.5 < landing(world, text, 0.05) / told(text, "overlap at impact").value < 1.0


def test_layers_that_land_overlap_as_if_undamped(world):
    """Each stops the next, and their dashpots take up little: deeper than a lone grain with them."""
    text = dry([[x, 1.05 * y + 5e-3] for x, y in hexagonal(10, 8)], 0.0107).replace("4000.0;", "1.0e5; damping = 0.5;")
    bound, config = told(text, "overlap at impact").value, configure(loads(text))
    alone = deepest_overlap(math.sqrt(2.0 * 9.81 * 5e-3), 2500.0 * math.pi / 4.0 * 1e-6, contact_law(config)) / 1e-3
    assert alone < landing(world, text, 0.045) < bound < 2.0 * alone


def landing(world, text, end):
    """The deepest overlap until a time (s)."""
    deepest = 0.0
    with running(world, "lbmdem", text) as app:
        while app.time < end:
            app.advance(20)
            deepest = max(deepest, app.scalars()["overlap"])
    return deepest


def test_a_packing_bears_those_above_it():
    """As if it were as many more layers of it; what lies below weighs nothing on it."""
    law = 'diameters = { law = "beta"; min = 0.9e-3; max = 1.1e-3; count = %d; }; packing = { low = %g; };'
    text = dry([], 0.02).replace("diameter = 1.0e-3; position = ();", law % (90, 0.0))
    upper = "{ density = 5000.0; %s }" % (law % (60, 0.02))
    both = text.replace("});", f"}}, {upper});")
    alone, (below, above) = told(text), rests(both)
    assert below == pytest.approx(alone.value * (1.0 + 60.0 * 5000.0 / (90.0 * 2500.0)), rel=1e-9)
    assert above == told(text.replace("90", "60").replace("2500.0", "5000.0")).value


def test_overlaps_of_a_grain_on_smaller_ones_are_over_their_diameter():
    """Two of them bear it, in 2D, and stop it; below it are those of sets that start lower."""
    row = [[1e-3 * (i + 0.5), 0.5e-3] for i in range(20)]
    text = dry(row, 0.02)
    onto = text.replace("});", "}, { density = 2500.0; diameter = 8.0e-3; position = [0.01, 0.015]; });")
    assert rests(onto)[1] == pytest.approx(WEIGHT * 64.0 / 2.0, rel=1e-9)
    fall = 0.015 - 0.004 - 20.0 * math.pi / 4.0 * 1e-6 / 0.02 / 0.8  # onto what the row fills
    law, mass = contact_law(configure(loads(text))), 2500.0 * math.pi / 4.0 * 64e-6
    depth = deepest_overlap(math.sqrt(2.0 * 9.81 * fall), mass, law)
    assert told(onto, "overlap at impact").value == pytest.approx(depth / math.sqrt(2.0) / 1e-3, rel=1e-9)
    alike = "grains[0].diameter=6.0e-3", "grains[0].position=[0.003, 0.003]"
    assert "smaller" not in told(onto, "overlap at impact", *alike).source


def rests(text):
    return [one.value for one in derived(configure(loads(text))) if one.name == "overlap at rest"]
