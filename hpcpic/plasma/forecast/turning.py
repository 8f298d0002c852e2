"""How far a magnetic field turns particles in a step, and by how much their orbits are too large for it."""

import math

from hpcpic.core.case.derived import Derived, judged
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.forecast.scales import (
    MOST_WITHOUT_FIELD,
    UNITS,
    field_axes,
    plasma_frequency,
    step_for,
    total_plasma_frequency,
)
from hpcpic.plasma.physics.boris import impulse_across

MOST_TURN = 1e6  # wc dt beyond which round-off of the turn heats: in 40 steps by 1e-5 at 1e12, by 5 at 1e15, measured
MOST_WAVE = 0.5  # wp dt of waves that a step resolves
MOST_TILT = 0.6  # B in the plane over B out of it: at 0.7 no heating by it is seen until wp t = 1600, at 0.5 much
WIDER = 1.01  # radius of an orbit over the true one that is told


def fastest_turn(config: PlasmaConfig) -> float:
    """Largest cyclotron frequency, rad/s."""
    ratios = (abs(species.charge / species.mass) for species in config.species if species.particles)
    return max(ratios, default=0.0) * math.hypot(*config.field.magnetic)


def larger_orbit(step: float, exact: bool) -> float:
    """Radius of the orbit of particles that turn by `step` rad in a step, over v/wc.

    A step is the chord v dt = 2 R sin(angle/2) of an orbit; half the angle is atan(wc dt/2), or wc dt/2 where exact.
    """
    return 0.5 * step / math.sin(0.5 * step) if exact else math.hypot(1.0, 0.5 * step)


def of_output(half: float) -> str:
    """What output tells of motions across B where that is off by 1 % or more, by the cosine of half the angle that a
    step turns: see docs/theory/plasma.md.
    """
    if half * half * WIDER > 1.0:
        return ""
    told = f"; output tells momenta of a gyration {half:.4g} times, u_NAME of a drift {1 / half:.4g} times"
    return f"{told} and its energy {1 / half**2:.4g} times as large"


def stronger_across(config: PlasmaConfig) -> float:
    """By what exact_phase multiplies the squared plasma frequency of waves across B that the step must resolve; 1
    where it is off, where B lies along all axes that have a field, and where a step is half a turn or more.
    """
    magnetic, dt = config.field.magnetic, abs(config.simulation.time_step)
    if not config.numerics.exact_phase or not across_waves(config) or fastest_turn(config) * dt >= math.pi:
        return 1.0
    squares = {i: plasma_frequency(config, species) ** 2 for i, species in enumerate(config.species)}
    turns = [species.charge / species.mass * math.hypot(*magnetic) * dt for species in config.species]
    total = sum(squares.values())
    return sum(own * impulse_across(turns[i]) for i, own in squares.items()) / total if total else 1.0


def across_waves(config: PlasmaConfig) -> bool:
    """Whether the magnetic field has a part across an axis that has a field: waves along it are upper hybrid ones."""
    fields = [axis for axis, n in enumerate(config.points) if n > MOST_WITHOUT_FIELD]
    return any(strength for axis in fields for other, strength in enumerate(config.field.magnetic) if other != axis)


def turn_across_grid(config: PlasmaConfig) -> float:
    """wc/wp of a magnetic field that leaves waves of the grid undamped: in 2D one out of the plane or tilted by less
    than MOST_TILT, in 3D any; 0 where there is none.
    """
    magnetic, wp = config.field.magnetic, total_plasma_frequency(config)
    if field_axes(config) < 2 or not wp or not any(magnetic):
        return 0.0
    strength = math.hypot(*magnetic)
    if field_axes(config) == 2:
        fields = [axis for axis, n in enumerate(config.points) if n > MOST_WITHOUT_FIELD]
        inside = math.hypot(*(magnetic[axis] for axis in fields))
        strength = math.hypot(*(one for axis, one in enumerate(magnetic) if axis not in fields))
        if inside >= MOST_TILT * strength:
            return 0.0
    return fastest_turn(config) * strength / math.hypot(*magnetic) / wp


def resolved_when_exact(config: PlasmaConfig) -> bool:
    """Whether the step would resolve waves across B with exact_phase, or be no worse there than now."""
    exact = config.numerics.model_copy(update={"exact_phase": True})
    stronger = stronger_across(config.model_copy(update={"numerics": exact}))
    waves = total_plasma_frequency(config) * abs(config.simulation.time_step)
    return waves * math.sqrt(stronger) <= MOST_WAVE or stronger < WIDER


def turning(config: PlasmaConfig, step: float) -> Derived:
    """The angle by which a particle turns in a step."""
    exact = config.numerics.exact_phase
    most, good = (math.pi, math.pi) if exact else (MOST_TURN, 0.35)
    limit = "< pi" if exact else "< 0.35 for the gyro-phase to 1 %" if step < most else f"< {most:g}"
    cure, source = f"time_step = {step_for(config, 0.349, step):g}", "Birdsall & Langdon ch. 4"
    if step >= MOST_TURN:
        cure += f", or a weaker field: a step only turns velocities round; {UNITS}"
    elif exact:
        cure += ", or numerics.exact_phase = false"
    elif step < math.pi and resolved_when_exact(config):
        cure += ", or numerics.exact_phase = true"
    if 0 < step < most:
        if (larger := larger_orbit(step, exact)) > WIDER:
            source += f"; the radii of orbits are {larger:.4g} times the true ones"
        if exact and (f := impulse_across(step)) > WIDER:  # the mass across B is m/f: docs/theory/plasma.md
            source += (
                f"; polarisation drifts and what particles add to waves far below wc are {1 / f:.4g} times as large"
            )
        source += of_output(math.cos(0.5 * step if exact else math.atan(0.5 * step)))
    return judged(
        "turn per step", "wc dt", step, unit="rad", limit=limit, ok=step <= good, legal=step < most, source=source,
        cure=cure, key=("simulation", "time_step"),
    )  # fmt: skip
