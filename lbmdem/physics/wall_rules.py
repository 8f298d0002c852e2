"""Wall rules: what comes back to a fluid node along a link that a wall crosses.

The link of a fluid node x along e_i ends at a solid node; the wall crosses it at x + q e_i. With y = x - e_i and
z = y - e_i behind x, j opposite to i and g the populations after the collision, a rule gives f_j(x) of the next step
as a sum of g_i(x), g_i(y), g_j(x), g_i(z), g_j(y) and, where the wall moves with velocity u, of
push = 6 w_i e_i . u (Ladd, J. Fluid Mech. 271 (1994) 285). Populations are zero-centred (f - w): a rule whose
coefficients add up to 1 does not notice. A fluid that moves with the wall is left as it is when the coefficient of
-push is one minus those of g_j.

A new rule is a formula, its line in `returned` and its entry in RULES; cases then name it as coupling.bounce_back. In a
file of the user's own, `register(name, formula)` does the same for one rule that reads no further than y.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.simd import frozen
from hpcpic.core.simd.formulas import fma, select
from hpcpic.core.simd.own import enter
from lbmdem.physics.velocity_sets import Lattice

CLI, INTERPOLATED, QUADRATIC, HALFWAY, OWN = range(5)


@dataclass(frozen=True)
class WallRule:
    """A rule by the name in a case and by its number in kernels.

    reach: fluid nodes behind x that it reads. simpler: the rule in its place where the last of these is solid.
    numbers: what a fixed link keeps of it: nothing, the factor of `finished`, or three coefficients.
    mean_push: the coefficient of -push, mean over q from 0 to 1.
    """

    name: str
    number: int
    reach: int
    simpler: int
    numbers: int
    mean_push: float


RULES = {
    rule.name: rule
    for rule in (
        WallRule("cli", CLI, 1, HALFWAY, 1, math.log(3.0)),
        WallRule("interpolated", INTERPOLATED, 1, HALFWAY, 3, 0.5 + 0.5 * math.log(2.0)),
        WallRule("quadratic", QUADRATIC, 2, INTERPOLATED, 3, 0.5 + math.log(4.0 / 3.0)),
        WallRule("halfway", HALFWAY, 0, HALFWAY, 0, 1.0),
    )
}
REACH = (*(rule.reach for rule in RULES.values()), 1)
SIMPLER = (*(rule.simpler for rule in RULES.values()), HALFWAY)


def halfway(gi_x: Any, push: Any) -> Any:
    """Half-way bounce back: the wall is taken to be at q = 1/2."""
    return gi_x - push


def own(q: Any, gi_x: Any, gi_y: Any, gj_x: Any, push: Any) -> Any:
    """The formula of `register` stands here."""
    return halfway(gi_x, push)


def register(name: str, formula: Callable[[Any, Any, Any, Any, Any], Any]) -> None:
    """Make a rule known by its name: formula(q, gi_x, gi_y, gj_x, push), linear in all but q, for numbers and vectors.

    One in a process, before anything of the lattice is compiled, and under a name of its own: else ValueError.
    """
    global own
    if OWN in (rule.number for rule in RULES.values()) or "lbmdem.kernels" in sys.modules:
        raise ValueError("one wall rule of your own, registered before the first simulation of the process")
    middles = (np.arange(1000) + 0.5) / 1000
    rule = WallRule(name, OWN, 1, HALFWAY, 3, -float(np.mean([formula(q, 0.0, 0.0, 0.0, 1.0) for q in middles])))
    enter(RULES, "wall rule", name, rule, lambda one: formula if one is rule else returned)
    own = formula  # type: ignore[assignment]
    frozen.keep(f"wall rule {name!r}", formula)


def cli(q: Any, gi_x: Any, gi_y: Any, gj_x: Any, push: Any) -> Any:
    """The parametrised linear rule CLI of Ginzburg & d'Humieres, Phys. Rev. E 68 (2003) 066614."""
    kappa = (1.0 - 2.0 * q) / (1.0 + 2.0 * q)
    return fma(kappa, (gi_y - gj_x) - push, gi_x - push)


def interpolated(q: Any, gi_x: Any, gi_y: Any, gj_x: Any, push: Any) -> Any:
    """The linear rule [6] of Bouzidi, Firdaouss & Lallemand, Phys. Fluids 13 (2001) 3452, (5)."""
    near = 2.0 * q * gi_x + (1.0 - 2.0 * q) * gi_y - push
    far = (gi_x - push + (2.0 * q - 1.0) * gj_x) / (2.0 * q)
    return select(q <= 0.5, near, far)


def quadratic(q: Any, gi_x: Any, gi_y: Any, gj_x: Any, gi_z: Any, gj_y: Any, push: Any) -> Any:
    """The quadratic rule of the same paper, (5)."""
    near = q * (2.0 * q + 1.0) * gi_x + (1.0 - 4.0 * q * q) * gi_y - q * (1.0 - 2.0 * q) * gi_z - push
    far = (gi_x - push) / (q * (2.0 * q + 1.0))
    far = far + (2.0 * q - 1.0) / q * gj_x - (2.0 * q - 1.0) / (2.0 * q + 1.0) * gj_y
    return select(q <= 0.5, near, far)


def returned(rule: Any, q: Any, gi_x: Any, gi_y: Any, gj_x: Any, gi_z: Any, gj_y: Any, push: Any) -> Any:
    """f_j(x) by the rule of this number, at a link with as many fluid nodes behind x as it reads."""
    if rule == CLI:
        return cli(q, gi_x, gi_y, gj_x, push)
    if rule == INTERPOLATED:
        return interpolated(q, gi_x, gi_y, gj_x, push)
    if rule == QUADRATIC:
        return quadratic(q, gi_x, gi_y, gj_x, gi_z, gj_y, push)
    if rule == OWN:
        return own(q, gi_x, gi_y, gj_x, push)
    return halfway(gi_x, push)


def begun(kappa: Any, gi_x: Any, gj_x: Any) -> Any:
    """What x knows of CLI at the end of the collision, at a wall at rest."""
    return fma(-kappa, gj_x, gi_x)


def finished(kappa: Any, gi_y: Any, first: Any) -> Any:
    """CLI from what was `begun` and from what arrives from y."""
    return fma(kappa, gi_y, first)


def applicable(rule: Any, behind: Any) -> Any:
    """The rule, or the simpler one that `behind` (0, 1, 2) fluid nodes behind x are enough for."""
    return rule if behind >= REACH[rule] else SIMPLER[rule] if behind >= REACH[SIMPLER[rule]] else HALFWAY


def coefficients(rule: Any, q: Any) -> Any:
    """Coefficients of g_i(x), g_i(y), g_j(x), g_i(z), g_j(y) and -push: a rule is linear in them."""
    return (
        returned(rule, q, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        returned(rule, q, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0),
        returned(rule, q, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        returned(rule, q, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0),
        returned(rule, q, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        -returned(rule, q, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
    )


def impedance(lattice: Lattice, rule: str, radius: ArrayLike) -> tuple[NDArray, NDArray]:
    """Mass and moment of inertia to add to grains of a radius so that light ones are stable, in lattice units.

    The force of the links changes by -zeta du when the grain's velocity changes by du within a step, zeta = sum over
    links of A 6 w e e (A: coefficient of -push). A backward Euler step of that part divides the force by m + zeta.
    The mean over all places of the grain: pi r^2 |e| links of a direction in 3D, 2 r |e| in 2D, at any q alike.
    """
    radius = np.asarray(radius, np.float64)
    length = np.sqrt(np.sum(lattice.e**2, axis=1))
    strength = float(np.sum(6.0 * lattice.w * length * length * length)) * RULES[rule].mean_push
    if lattice.dimensions == 3:
        mass = strength * math.pi / 3.0 * radius**2
        return mass, 0.5 * mass * radius**2
    return strength * radius, 2.0 / 3.0 * strength * radius * radius * radius
