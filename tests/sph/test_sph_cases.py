"""Every shipped case is legal, and takes its first steps."""

import math

import pytest

from hpcpic.core.files.config import load
from hpcpic.core.files.schema import validate
from hpcpic.core.tasks import Pool
from hpcpic.core.timers import Timers
from sph.cases import shipped_cases
from sph.config import SphConfig
from sph.derived import derived
from sph.estimate import estimate
from sph.plan import plan

COARSE = {  # settings that leave the kind of scene as it is and make it small
    "column-impact-a": ("numerics.spacing=0.04",),
    "column-impact-b": ("numerics.spacing=0.04", "wall[2].shape.box.high=[0.44, 0.61, 0.45]"),
    "column-impact-h": ("numerics.spacing=0.04",),
    "hydrostatic": ("numerics.spacing=0.04", "numerics.smoothing=1.0"),
    "oscillating-piston": ("numerics.spacing=0.04",),
    "still-tank": ("numerics.spacing=0.1",),
    "standing-wave": ("numerics.spacing=0.1",),
    "dam-break-pressure": ("numerics.spacing=0.05",),
}
TAKEN_AS_ANOTHER = ("column-impact-c", "column-impact-f", "column-impact-i", "column-impact-j", "column-impact-k")


@pytest.mark.parametrize("name", shipped_cases())
def test_a_shipped_case_is_within_its_limits(name):
    config = validate(SphConfig, load(shipped_cases()[name]))
    assert [str(number) for number in derived(config, 2) if number.verdict == "fail"] == []


@pytest.mark.validation  # each kind of scene is compiled
@pytest.mark.parametrize("name", [name for name in shipped_cases() if name not in TAKEN_AS_ANOTHER])
def test_a_shipped_case_takes_its_first_steps(name, world):
    from sph.step import Sph

    config = validate(SphConfig, load(shipped_cases()[name], COARSE.get(name, ())))
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
    name = "still-tank"
    coarse, fine = (
        validate(SphConfig, load(shipped_cases()[name], (f"numerics.spacing={dp}",))) for dp in (0.01, 0.005)
    )
    one = [estimate(config, 1, 1, {}) for config in (coarse, fine)]
    launches = estimate(validate(SphConfig, load(shipped_cases()[name], ("numerics.spacing=0.5",))), 1, 1, {})
    ratio = (one[1].step_seconds - launches.step_seconds) / (one[0].step_seconds - launches.step_seconds)
    assert ratio == pytest.approx(4.0, rel=0.05)
    assert one[1].seconds > 5 * one[0].seconds  # steps are half as long, but for what each costs in any case
    assert estimate(fine, 1, 2, {}).step_seconds < 0.6 * one[1].step_seconds
    assert sum(estimate(fine, 2, 1, {}).memory.values()) < sum(one[1].memory.values())


def test_the_plan_has_no_line_for_what_a_case_has_not():
    drop = "\n".join(plan(validate(SphConfig, load(shipped_cases()["elliptical-drop"])), 1, 1))
    assert "walls" not in drop and "viscosity" not in drop and "renormalis" not in drop and "no messages" in drop
    still = "\n".join(plan(validate(SphConfig, load(shipped_cases()["still-tank"])), 2, 1))
    assert "walls" in still and "renormalised gradient" in still and "ghosts" in still
