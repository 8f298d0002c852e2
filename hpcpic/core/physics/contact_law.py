"""Contacts of solids by springs, dashpots and friction (Cundall & Strack 1979; Mansouri et al. 2011): the forces of one
contact, its restitution, and the largest step.

The functions on forces are formulas: for numbers, and compiled for vectors of contacts. Vectors of three are tuples: n
the unit normal from the first body to the second, t the velocity of the second surface less that of the first, along
the contact. dt: the time step (s).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.formulas import fma, maximum, minimum, select, sqrt

Vector = tuple[Any, Any, Any]
SHEAR_RATIO = 2.0 / 7.0  # tangential stiffness over the normal one, where a case gives none


class ContactLaw(NamedTuple):
    """Parameters of the contact law, SI units.

    stiffness k_n (N/m), damping alpha in [0, 1), friction mu, viscosity beta (N s/m) of the regularised Coulomb law;
    shear (N/m): 0 for the law of the paper, else stiffness of a tangential spring with history, beside which
    `viscosity` is its dashpot. pulls: the dashpot may pull at the end of a contact, as in the paper.
    """

    stiffness: float
    damping: float = 0.0
    friction: float = 0.0
    viscosity: float = 0.0
    shear: float = 0.0
    pulls: bool = True


class NormalForce(NamedTuple):
    """The force along the normal of a contact, and numbers beside it; forces and power are per metre of depth in 2D.

    force (N) pushes the bodies apart; travel (m): what the overlap changes by in a step; steps: overlap over travel, so
    many steps ago the contact began, or so many ahead it ends; loss (W): power that the dashpot turns into heat.
    """

    force: Any
    travel: Any
    steps: Any
    loss: Any


def dot(a: Vector, b: Vector) -> Any:
    """Scalar product."""
    return fma(a[2], b[2], fma(a[1], b[1], a[0] * b[0]))


def slip_velocity(u: Vector, spin: Vector, n: Vector, opening: Any) -> Vector:
    """Velocity of the surfaces along the contact: u - n (u n) - spin x n; spin: sum of arm x angular velocity."""
    return (
        fma(-opening, n[0], u[0]) - fma(spin[1], n[2], -(spin[2] * n[1])),
        fma(-opening, n[1], u[1]) - fma(spin[2], n[0], -(spin[0] * n[2])),
        fma(-opening, n[2], u[2]) - fma(spin[0], n[1], -(spin[1] * n[0])),
    )


def normal_force(overlap: Any, opening: Any, damping: Any, law: ContactLaw, dt: float) -> NormalForce:
    """Spring and dashpot. overlap (m); opening (m/s): velocity of the second body less that of the first, along n, so
    positive where they part; damping (N s/m): of the dashpot of this pair; dt (s).

    The force jumps when a contact begins or ends inside a step, s steps ago or ahead, as found from the overlap and its
    rate. The dashpots of the two instants next to it are multiplied by 3 s / 2 (s < 1) and 2 - s / 2 (s < 2): together
    the time in contact, 1/2 + s steps for s < 1, and continuous in s. That makes the impulse of a collision second
    order in the step.
    """
    travel = abs(opening) * dt
    steps = overlap / travel  # s of the text
    share = minimum(1.5 * steps, maximum(fma(steps, -0.5, 2.0), 1.0))
    share = select(travel > 0.0, share, 1.0)
    if not law.pulls:
        share = select(opening < 0.0, share, 1.0)  # such a contact ends without a jump
    dashpot = share * damping * opening
    normal = fma(overlap, law.stiffness, -dashpot)
    if not law.pulls:
        dashpot = select(normal < 0.0, law.stiffness * overlap, dashpot)
        normal = maximum(normal, 0.0)
    return NormalForce(normal, travel, steps, dashpot * opening)


def spring_energy(overlap: Any, law: ContactLaw) -> Any:
    """Energy of the normal spring at an overlap (m), J."""
    return 0.5 * law.stiffness * (overlap * overlap)


def deepest_overlap(speed: float, mass: float, law: ContactLaw) -> float:
    """The overlap (m) at which a body (kg) that meets a wall at this speed (m/s) turns round; of spring and dashpot."""
    damped = math.sqrt(1.0 - law.damping**2)
    return speed * math.sqrt(mass / law.stiffness) * math.exp(-law.damping / damped * math.acos(law.damping))


def restitution(damping: float) -> float:
    """Speed after a collision over that before, of a contact that does not pull (Schwager & Poschel 2007, eq. 21)."""
    root = math.sqrt(abs(1.0 - damping**2))
    if damping < 1.0:
        return math.exp(-damping / root * math.atan2(2.0 * damping * root, 2.0 * damping**2 - 1.0)) if damping else 1.0
    if damping == 1.0:
        return math.exp(-2.0)
    return ((damping + root) / (damping - root)) ** (-damping / root)


def damping_of(bounce: float) -> float:
    """The damping alpha of a contact that does not pull, of this restitution (0.01 .. 1), by bisection."""
    low, high = 0.0, 8.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if restitution(middle) > bounce else (low, middle)
    return low


def regularised_friction(t: Vector, limit: Any, viscosity: float) -> tuple[Vector, Any]:
    """Friction min(beta v, mu N) against the slip, as in the paper; heat per time. limit: mu N."""
    slip = sqrt(dot(t, t))
    factor = minimum(limit / slip, viscosity)
    factor = select(slip > 0.0, factor, 0.0)  # 0 / 0 at rest
    return (factor * t[0], factor * t[1], factor * t[2]), factor * slip * slip


def spring_friction(
    spring: Vector, n: Vector, t: Vector, limit: Any, law: ContactLaw, lead: Any, dt: float
) -> tuple[Vector, Any, Vector]:
    """Friction of a tangential spring and dashpot in parallel, each at most mu N; heat per time; the new spring.

    The spring is kept half a step ahead of the step's end, so that its length there, after `lead` (s), half a step or
    since the contact began, is a trapezoidal sum; its energy is counted as it is kept.
    """
    shear, viscosity, half = law.shear, law.viscosity, 0.5 * dt
    sx, sy, sz = spring
    before = dot(spring, spring)
    along = dot(spring, n)  # the contact plane turns, and the spring with it
    sx, sy, sz = fma(-along, n[0], sx), fma(-along, n[1], sy), fma(-along, n[2], sz)
    after = dot((sx, sy, sz), (sx, sy, sz))
    stretch = select(after > 0.0, sqrt(before / after), 1.0)
    sx, sy, sz = fma(t[0], lead, stretch * sx), fma(t[1], lead, stretch * sy), fma(t[2], lead, stretch * sz)
    held = shear * sqrt(dot((sx, sy, sz), (sx, sy, sz)))
    slips = select(held > limit, limit / held, 1.0)
    ex, ey, ez = slips * sx, slips * sy, slips * sz
    fx, fy, fz = fma(ex, shear, viscosity * t[0]), fma(ey, shear, viscosity * t[1]), fma(ez, shear, viscosity * t[2])
    whole = sqrt(dot((fx, fy, fz), (fx, fy, fz)))
    cut = select(whole > limit, limit / whole, 1.0)
    force = fx * cut, fy * cut, fz * cut
    kept = fma(t[0], half, ex), fma(t[1], half, ey), fma(t[2], half, ez)
    work = dot(force, t) * dt
    stored = dot(kept, kept) - before
    heat = select(dt > 0.0, (work - 0.5 * shear * stored) / dt, 0.0)
    return force, heat, kept


def step_limit(damping: float, contacts: float) -> float:
    """Largest stable step of the scheme for `contacts` parallel contacts with fixed neighbours, times sqrt(k/m).

    The scheme's matrix has the eigenvalue -1 where z dt^2 + 8 alpha z dt = 4 (stiffness z k, dashpots
    2 alpha z sqrt(k m), velocities predicted by the old acceleration).
    """
    return 4.0 * (math.sqrt(damping**2 + 0.25 / contacts) - damping)


def stable_step(law: ContactLaw, radius: NDArray, mass: NDArray, inertia: NDArray) -> float:
    """Largest stable step (s) of grains that move: a bound for the lightest of them among its equals.

    As many contacts act along one direction as equal discs (3) or spheres (4.5) can have: they are 60 degrees apart,
    and one at an angle a counts cos^2 a. Neighbours in antiphase act as half the mass. Tangential springs and dashpots,
    twice as many along a direction or about an axis, are added.
    """
    if len(mass) == 0:
        return math.inf
    k = int(np.argmin(mass))
    planar = inertia[k] > 0.45 * mass[k] * radius[k] ** 2
    contacts = 3.0 if planar else 4.5
    normal = 2.0 / mass[k]  # 1/kg: 1 / reduced mass of two of them, along the normal
    tangential = 2.0 * (normal + 2.0 * radius[k] ** 2 / inertia[k])  # 1/kg: along the contact, both turn; twice as many
    # 1/s2: stiffness of all springs over the reduced mass
    spring = contacts * (law.stiffness * normal + law.shear * tangential)
    # 1/s: viscosity of all dashpots over the reduced mass
    dashpot = contacts * (2.0 * law.damping * math.sqrt(law.stiffness * normal) + law.viscosity * tangential)
    return 2.0 / (dashpot + math.sqrt(dashpot**2 + spring))
