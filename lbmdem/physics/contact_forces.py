"""The contact law of Mansouri et al. 2011, equation [1], as forces of one contact; compiled for vectors of contacts.

Vectors of three are tuples: n the unit normal from the first body to the second, t the velocity of the second surface
less that of the first, along the contact. dt: the time step (s).
"""

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import Vec, fma, maximum, minimum, select, splat, sqrt
from lbmdem.physics.contact_law import LANES

F = Vec(LANES, "float64")


@njit(inline="always")
def dot(a, b):
    """Scalar product."""
    return fma(a[2], b[2], fma(a[1], b[1], a[0] * b[0]))


@njit(inline="always")
def slip_velocity(u, spin, n, opening):
    """Velocity of the surfaces along the contact: u - n (u n) - spin x n; spin: sum of arm x angular velocity."""
    return (
        fma(-opening, n[0], u[0]) - fma(spin[1], n[2], -(spin[2] * n[1])),
        fma(-opening, n[1], u[1]) - fma(spin[2], n[0], -(spin[0] * n[2])),
        fma(-opening, n[2], u[2]) - fma(spin[0], n[1], -(spin[1] * n[0])),
    )


@njit(inline="always")
def normal_force(overlap, opening, damping, law, dt):
    """Spring and dashpot: the force, what the overlap changes by in a step, steps of contact, loss of power.

    The force jumps when a contact begins or ends inside a step, s steps ago or ahead, as found from the overlap and its
    rate. The dashpots of the two instants next to it are multiplied by 3 s / 2 (s < 1) and 2 - s / 2 (s < 2): together
    the time in contact, 1/2 + s steps for s < 1, and continuous in s. That makes the impulse of a collision second
    order in the step.
    """
    travel = abs(opening) * dt
    depth = overlap / travel  # s
    share = minimum(1.5 * depth, maximum(fma(depth, -0.5, splat(F, 2.0)), splat(F, 1.0)))
    share = select(travel > 0.0, share, splat(F, 1.0))
    if not law.pulls:
        share = select(opening < 0.0, share, splat(F, 1.0))  # such a contact ends without a jump
    dashpot = share * damping * opening
    normal = fma(overlap, law.stiffness, -dashpot)
    if not law.pulls:
        dashpot = select(normal < 0.0, law.stiffness * overlap, dashpot)
        normal = maximum(normal, splat(F, 0.0))
    return normal, travel, depth, dashpot * opening


@njit
def regularised_friction(t, limit, viscosity):
    """Friction min(beta v, mu N) against the slip, as in the paper; heat per time. limit: mu N."""
    slip = sqrt(dot(t, t))
    factor = minimum(limit / slip, splat(F, viscosity))
    factor = select(slip > 0.0, factor, splat(F, 0.0))  # 0 / 0 at rest
    return (factor * t[0], factor * t[1], factor * t[2]), factor * slip * slip


@njit
def spring_friction(spring, n, t, limit, law, lead, dt):
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
    stretch = select(after > 0.0, sqrt(before / after), splat(F, 1.0))
    sx, sy, sz = fma(t[0], lead, stretch * sx), fma(t[1], lead, stretch * sy), fma(t[2], lead, stretch * sz)
    held = shear * sqrt(dot((sx, sy, sz), (sx, sy, sz)))
    slips = select(held > limit, limit / held, splat(F, 1.0))
    ex, ey, ez = slips * sx, slips * sy, slips * sz
    fx, fy, fz = fma(ex, shear, viscosity * t[0]), fma(ey, shear, viscosity * t[1]), fma(ez, shear, viscosity * t[2])
    whole = sqrt(dot((fx, fy, fz), (fx, fy, fz)))
    cut = select(whole > limit, limit / whole, splat(F, 1.0))
    force = fx * cut, fy * cut, fz * cut
    kept = fma(t[0], half, ex), fma(t[1], half, ey), fma(t[2], half, ez)
    work = dot(force, t) * dt
    stored = dot(kept, kept) - before
    heat = select(splat(F, dt) > 0.0, (work - 0.5 * shear * stored) / dt, splat(F, 0.0))
    return force, heat, kept
