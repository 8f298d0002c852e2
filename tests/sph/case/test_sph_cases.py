"""Every shipped case is legal, and takes its first steps."""

import math

import numpy as np
import pytest

from hpcpic.core.case.config import load, loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.app import shipped_cases
from sph.case import geometry
from sph.case.config import SphConfig
from sph.configure import configure
from sph.forecast.derived import derived
from sph.forecast.estimate import estimate
from sph.forecast.plan import images, plan
from sph.physics.stability import time_step

BUOYS = """
simulation = {{ dimensions = 2; end_time = 1.0; }};
gravity = [0.0, -9.81];
fluid = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 0.5]; }}; }}; }} );
numerics = {{ spacing = 0.02; }};
wall = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 0.6]; open = ["y+"]; }}; }}; }}{} );
"""
COARSE = {  # settings that leave the kind of scene as it is and make it small
    "column-impact-a": ("numerics.spacing=0.04",),
    "column-impact-b": ("numerics.spacing=0.04", "wall[2].shape.box.high=[0.44, 0.61, 0.45]"),
    "column-impact-h": ("numerics.spacing=0.04",),
    "column-impact-printed": ("numerics.spacing=0.04",),
    "hydrostatic": ("numerics.spacing=0.04", "numerics.smoothing=1.0"),
    "oscillating-piston": ("numerics.spacing=0.04",),
    "still-tank": ("numerics.spacing=0.1",),
    "standing-wave": ("numerics.spacing=0.1",),
    "interfacial-wave": ("numerics.spacing=0.1",),
    "dam-break-pressure": ("numerics.spacing=0.05",),
}
TAKEN_AS_ANOTHER = ("column-impact-c", "column-impact-f", "column-impact-i", "column-impact-j", "column-impact-k")


@pytest.mark.parametrize("name", shipped_cases())
def test_a_shipped_case_is_within_its_limits(name):
    config = configure(load(shipped_cases()[name]))
    assert [str(number) for number in derived(config, 2) if number.verdict == "fail"] == []


@pytest.mark.parametrize("name", [name for name in shipped_cases() if name.startswith("column-impact")])
def test_the_tank_of_the_column_impact_is_that_of_the_paper(name):
    """SC figure 1: 1.6 x 0.61 x 0.75 m, 0.4 m of it with 0.3 m of water, 10 mm on the floor; a column of 0.12 m stands
    0.5 m behind the gate and 0.24 m from a side.
    """
    config = configure(load(shipped_cases()[name]))
    boxes = {part.name: geometry.bounds(part.shape) for part in (*config.fluid, *config.wall)}
    assert boxes["tank"] == ((0.0, 0.0, 0.0), (1.6, 0.61, 0.75)) == config.domain.corners
    assert boxes["reservoir"] == ((0.0, 0.0, 0.0), (0.4, 0.61, 0.3))
    assert boxes["bed"] == ((0.4, 0.0, 0.0), (1.6, 0.61, 0.01))
    size, place = np.subtract(*boxes["column"][::-1]), np.subtract(boxes["column"][0], (0.4, 0.0, 0.0))
    np.testing.assert_allclose([size, place], [(0.12, 0.12, 0.75), (0.5, 0.24, 0.0)], atol=1e-12)
    assert config.gravity == (0.0, 0.0, -9.81)


@pytest.mark.parametrize("name", ["poiseuille", "standing-wave", "taylor-green"])
def test_images_are_about_as_many_as_planned(name):
    """At the scene's own spacing: a third to three quarters as many as the particles of the fluid, or few."""
    from sph.step import Sph

    config, pool = configure(load(shipped_cases()[name])), Pool(1)
    try:
        app = Sph(config, World.alone(), pool, Timers())
        assert images(config) == pytest.approx(np.count_nonzero(app.storage.flags) - app.storage.n, rel=0.2)
    finally:
        pool.close()


@pytest.mark.validation  # each kind of scene is compiled
@pytest.mark.parametrize("name", [name for name in shipped_cases() if name not in TAKEN_AS_ANOTHER])
def test_a_shipped_case_takes_its_first_steps(name, world):
    from sph.step import Sph

    config = configure(load(shipped_cases()[name], COARSE.get(name, ())))
    pool = Pool(1)
    try:
        app = Sph(config, world, pool, Timers())
        before = app.scalars()
        for _ in range(3):
            app.step()
        after = app.scalars()
        app.close()
    finally:
        pool.close()
    assert set(before) == set(app.scalar_units) and set(after) <= set(before)  # some gauges have a period
    assert all(map(math.isfinite, after.values()))
    assert after["mass"] == before["mass"] and app.time > 0
    assert app.guard() is None


def test_the_estimate_scales_with_the_case():
    """Four times the particles: four times the pair sums; two cores: less than half of it is lost."""
    coarse, fine, launches = (still_tank(f"numerics.spacing={dp}") for dp in (0.01, 0.005, 0.5))
    one = [estimate(config, 1, 1, {}) for config in (coarse, fine)]
    step, larger, least = (sum(estimate(config, 1, 1, {}).phases.values()) for config in (coarse, fine, launches))
    assert (larger - least) / (step - least) == pytest.approx(4.0, rel=0.05)
    assert one[1].seconds > 5 * one[0].seconds  # steps are half as long, but for what each costs in any case
    assert estimate(fine, 1, 2, {}).step_seconds < 0.65 * one[1].step_seconds
    assert sum(estimate(fine, 2, 1, {}).memory.values()) < sum(one[1].memory.values())


def test_what_bodies_take_is_counted_by_body_and_by_their_rates():
    """A buoy, the line that it hangs on, and a second buoy; a scene without any counts nothing."""
    buoy = """, {{ solid = true; shape = {{ sphere = {{ centre = [{x}, 0.3]; radius = 0.05; }}; }};
        body = {{ density = 300.0; {line} }}; }}"""
    line = "mooring = ( { at = [0.3, 0.3]; anchor = [0.3, 0.0]; stiffness = 1.0; } );"

    def bodies(*walls: str) -> float:
        text = BUOYS.format("".join(walls))
        return estimate(configure(loads(text)), 1, 1, {"rigid_us": 3e6, "mooring_us": 5e6}).phases["bodies"]

    one, two = (buoy.format(x=x, line="") for x in (0.3, 0.7))
    found = [bodies(), bodies(one), bodies(one, two), bodies(buoy.format(x=0.3, line=line), two)]
    assert found == pytest.approx([0.0, 3.0, 6.0, 11.0])


def still_tank(*sets: str) -> SphConfig:
    return configure(load(shipped_cases()["still-tank"], sets))


def test_a_step_after_a_sample_is_cheaper_by_what_the_sample_has_done():
    """The first evaluation is there already, and the run takes no less than without samples."""
    often, never = (estimate(still_tank(f"output.period.series={s}"), 1, 1, {}) for s in (1e-9, 0.0))
    assert often.phases == never.phases and never.step_seconds == sum(never.phases.values())
    assert 0.2 * never.step_seconds < often.step_seconds < 0.8 * never.step_seconds
    assert often.seconds >= never.seconds and never.sampling == 0.0
    dt = time_step(still_tank())
    most, least = (estimate(still_tank(f"output.period.series={k * dt}"), 1, 1, {}) for k in (1.8, 2.2))
    assert (most.step_seconds, least.step_seconds) == (often.step_seconds, never.step_seconds)  # medians, as of runs


def test_the_plan_has_no_line_for_what_a_case_has_not():
    drop = "\n".join(plan(configure(load(shipped_cases()["elliptical-drop"])), 1, 1))
    assert "walls" not in drop and "viscosity" not in drop and "renormalis" not in drop and "no messages" in drop
    still = "\n".join(plan(configure(load(shipped_cases()["still-tank"])), 2, 1))
    assert "walls" in still and "renormalised gradient" in still and "ghosts" in still
