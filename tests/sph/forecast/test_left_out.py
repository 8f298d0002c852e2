"""Where surface tension or walls that pull, which no equation has, would count is told before the run."""

import pytest
from test_sph_plausibility import PARTS, told

TENSION = "surface tension of water, which is left out"
HANGING = "pressure of rest in water over its free surface"
CUP = """{ name = "cup"; solid = true; shape = { polygon = { corners = ([0.35, 0.1], [0.4, 0.1], [0.4, 0.5],
    [0.6, 0.5], [0.6, 0.1], [0.65, 0.1], [0.65, 0.55], [0.35, 0.55]); }; }; } )"""
HANGS = "[0.0, 0.0], [1.0, 0.0], [1.0, 0.2], [0.6, 0.2], [0.6, 0.5], [0.4, 0.5], [0.4, 0.2], [0.0, 0.2]"
LEVEL = "[0.0, 0.0], [1.0, 0.0], [1.0, 0.2], [0.0, 0.2]"
SLOPES = "[0.0, 0.0], [1.0, 0.0], [1.0, 0.1], [0.0, 0.3]"


def scaled(size, **parts):
    """Water of a third of a tank of this size in m."""
    tank = PARTS["wall"].replace("1.0, 1.0", f"{size}, {size}")
    water = PARTS["fluid"].replace("1.0, 0.3", f"{size}, {0.3 * size}")
    domain = PARTS["domain"].replace("1.0, 1.0", f"{size}, {size}")
    return told(**{"wall": tank, "fluid": water, "domain": domain,
                   "numerics": f"{{ spacing = {size / 20}; }}", **parts}).get(TENSION)  # fmt: skip


@pytest.mark.parametrize("size, verdict", [(1.0, None), (0.1, "ok"), (0.02, "warn"), (0.002, "warn")])
def test_water_of_a_few_millimetres_is_told_of_surface_tension(size, verdict):
    number, depth = scaled(size), 0.3 * size
    assert (number and number.verdict) == verdict
    if number:  # of a dam that breaks: half of one over the number of Bond
        assert number.value == pytest.approx(0.0728 / (2 * 9810.0 * depth**2), rel=0.02)


def test_fast_and_covered_water_is_not():
    assert scaled(0.02, eos="{ max_velocity = 20.0; }") is None
    closed = PARTS["wall"].replace("1.0, 1.0", "0.02, 0.006").replace('open = ["y+"]; ', "")
    assert scaled(0.02, wall=closed) is None


@pytest.mark.parametrize("corners, lowest", [(HANGS, -9810.0 * 0.29), (LEVEL, None), (SLOPES, None)])
def test_water_over_its_free_surface_under_walls_is_told(corners, lowest):
    water = f'( {{ name = "water"; shape = {{ polygon = {{ corners = ({corners}); }}; }}; }} )'
    number = told(fluid=water, wall=f"{PARTS['wall'][:-1]}, {CUP}", numerics="{ spacing = 0.02; }").get(HANGING)
    assert (number and number.value) == (lowest and pytest.approx(lowest, rel=1e-6))
