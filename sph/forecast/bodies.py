"""Rigid bodies: gaps to what is beside them, how light they are, and how many spacings they are across."""

import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived, Verdict, judged, rounded_down
from sph.case import geometry
from sph.case.config import AXES
from sph.setup.rigid.mass import share
from sph.setup.rigid.surfaces import TOUCHING, gap, stays
from sph.setup.scene import Scene, Wall

LIGHTEST = 0.03  # mass of a body over that of it and a layer of fluid
FEWEST, FEWEST_LIGHT = 4, 8  # spacings across, below which a body starts by a tenth wrong; what is light, in 3D
SMALL = {
    2: "a disc half as heavy as water starts by -24 % (2), -8 % (4), measured",
    3: "a ball starts, half as heavy as water, by -22 % (4), -14 % (6), -10 % (8); twice as heavy +5 % (4), measured",
}


def bodies(scene: Scene) -> Iterator[Derived]:
    """All of it."""
    yield from gaps_and_masses(scene)
    yield from small(scene)


def gaps_and_masses(scene: Scene) -> Iterator[Derived]:
    """Gaps between rigid bodies and walls, and how light a body is."""
    told: set[frozenset[str]] = set()  # pairs, each of which is told once
    for wall in scene.walls:
        if not wall.rigid:
            continue
        x, key = wall.near(*wall.bounds)[1], ("wall", wall.index)
        others = [other for other in scene.walls if other is not wall and {wall.name, other.name} not in told]
        gaps = [(gap(wall, other), other.name) for other in others]
        for least, name in sorted(gaps)[:1]:
            told.add(frozenset((wall.name, name)))
            limit, verdict, source, cure = judged_gap(scene, wall, name, least)
            yield Derived(f"gap between {wall.name} and {name}", "", least, "m", limit, verdict, source, cure,
                          (*key, "shape"))  # fmt: skip
        part = share(wall, x)
        verdict = "ok" if part >= LIGHTEST else "fail"
        cure = "" if verdict == "ok" else "a larger density, or a smaller spacing"
        yield Derived(f"mass of {wall.name} over that with a layer of fluid", "", part, "", f">= {LIGHTEST:g}", verdict,
                      "measured: 0.038 stands, 0.013 diverges", cure, (*key, "body", "density"), True)  # fmt: skip


def judged_gap(scene: Scene, wall: Wall, name: str, least: float) -> tuple[str, Verdict, str, str]:
    """Limit, verdict, source and cure of the gap, m, between a body and what is nearest to it."""
    spacing, hinge = scene.spacing, wall.section.body and wall.section.body.hinge
    if least < -TOUCHING * spacing:
        apart = f"a place where it touches {name} or is away from it"
        return ">= 0", "fail", "contacts push apart what overlaps", apart
    if hinge and least < (1.0 + TOUCHING) * spacing:
        return (f"> {spacing:g}, at which solids touch", "warn",
                f"contacts bear what turns {wall.name} towards {name}, and keep it from turning",
                f"a gap of more than {spacing:g} m at any angle that it comes to; fluid goes through it")  # fmt: skip
    if wet(scene, wall) and least < (1.0 - TOUCHING) * spacing:
        lifts = "" if stays(wall) else ", and lifts 2.4 spacings at each edge (h/dp 1.5), measured"
        return (f">= {spacing:g}, a layer of fluid", "warn",
                f"no fluid gets between them: what is around {wall.name} presses it against {name}{lifts}",
                f"a gap of {spacing:g} m")  # fmt: skip
    return ">= 0", "ok", "contacts push apart what overlaps", ""


def wet(scene: Scene, wall: Wall) -> bool:
    """If a fluid is around a body, or beside it as before a gate, at t = 0."""
    low, high = (np.array(corner) for corner in geometry.bounds(wall.shape))
    waters = [geometry.bounds(fluid.section.shape) for fluid in scene.fluids if fluid.n]
    beside = 0.5 * scene.spacing
    return any(np.all(low - beside < top) and np.all(high + beside > bottom) for bottom, top in waters)


def small(scene: Scene) -> Iterator[Derived]:
    """Bodies free to move, of which the buoyancy and what moves with them are those of a few particles."""
    d = scene.dimensions
    for wall in scene.walls:
        body, volume = wall.section.body, geometry.volume(wall.shape)
        if not (body and wall.rigid and scene.n_fluid) or body.hinge or set(AXES[:d]) <= set(body.held):
            continue
        across = 2.0 * (volume / math.pi) ** 0.5 if d == 2 else (6.0 * volume / math.pi) ** (1 / 3)
        least = FEWEST_LIGHT if d == 3 and wall.rigid.mass < scene.rho0 * volume else FEWEST
        yield judged(f"spacings across {wall.name}", "d/dp", across / scene.spacing, limit=f">= {least}",
                     ok=across >= least * (1 - 1e-9) * scene.spacing, legal=True, source=SMALL[d],
                     cure=f"spacing = {rounded_down(across / least):g}", key=("numerics", "spacing"))  # fmt: skip
