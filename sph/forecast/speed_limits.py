"""Speeds that the sound speed of a case is to be compared with, besides those that its default knows."""

from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged
from sph.case.config import SphConfig
from sph.setup.scene import Scene
from sph.setup.speeds import pushing_speed

LEAST_FACTOR = 7.0  # c0 over the largest speed of fluid, below which its density is off by 2 %


def speed_limits(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """All of them."""
    yield from pushing_walls(config, scene)


def pushing_walls(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Walls that take fluid with them: it becomes as fast as they are. A gate that leaves it does not."""
    for wall in scene.walls:
        speed = pushing_speed(wall, config.simulation.end_time) if wall.moving else 0.0
        if speed:
            yield judged(f"sound speed over the speed of {wall.name}", "c0/v", config.sound_speed / speed,
                         limit=f">= {LEAST_FACTOR:g}", ok=config.sound_speed >= LEAST_FACTOR * speed, legal=True,
                         source="it takes fluid with it", key=("eos", "max_velocity"),
                         cure=f"max_velocity = {speed:.3g}, or sound_speed = {10 * speed:.3g}")  # fmt: skip
