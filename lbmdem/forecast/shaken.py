"""What shaking makes of a fluid that solids hold: a layer on them, which the nodes and steps have to resolve.

Measured are flows between two walls that the frame shakes along themselves, beside the exact ones
(docs/measured/lbmdem.md).
"""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.forecast.relaxation import SPACING, finer, key_of_tau, slower

THIN = 0.8  # nodes in the layer, with which the velocity is off by 4 % of its largest
LONG = 0.1  # (tau - 1/2) omega dt, likewise 5 %


def layers(config: LbmDemConfig) -> Iterator[Derived]:
    """Thickness sqrt(2 nu/omega) of the layer that solids drag along in a shaken fluid, and what a step makes of it."""
    if config.shaking is None or not (config.grains or config.obstacle or slides(config)):
        return
    omega, dx = 2.0 * math.pi * config.shaking.frequency, config.spacing
    thick = math.sqrt(2.0 * config.liquid.kinematic_viscosity / omega)
    yield judged(
        "layer of fluid that solids drag along", "sqrt(2 nu/w)/dx", thick / dx, legal=True,
        ok=thick >= THIN * dx * (1.0 - 1e-9), limit=f">= {THIN:g}",
        source="velocity by a shaken wall, off by 14 % at 0.47, 3 at 0.94, 0.6 at 1.9",
        cure=f"{finer(config, thick / THIN)} resolves it", key=SPACING,
    )  # fmt: skip
    swing = (config.tau - 0.5) * omega * config.time_step
    yield judged(
        "shaking in a step", "(tau - 1/2) w dt", swing, ok=swing <= LONG, legal=True, limit=f"<= {LONG:g}",
        source="velocity by a shaken wall, off by 1 % at 0.07, 3 to 11 % at 0.19, 20 at 0.75",
        cure=f"relaxation_time = {slower(config, 0.99 * math.sqrt(LONG / swing))}", key=key_of_tau(config),
    )  # fmt: skip


def slides(config: LbmDemConfig) -> bool:
    """Whether the frame shakes walls along themselves."""
    parts = config.shaking.acceleration if config.shaking else ()
    return any(part and AXES[k] in config.unwalled and config.walled(k) for k, part in enumerate(parts))
