"""The plasma's scalars in time: energies, momentum, charge and field modes, all at one time level.

Another one is a name, a unit and a function of a sample, registered; what it sums over particles is a Moment, whose
integrand is written once:

    def energy_flux(vx, vy, vz, square):
        return square * vx, square * vy, square * vz

    ENERGY_FLUX = Moment(energy_flux, power=3, vector=True)
    register(Scalar("energy_flux_x", "W m", lambda sample: sum(0.5 * s.m * s[ENERGY_FLUX][0] for s in sample.species),
                    (ENERGY_FLUX,)))
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from hpcpic.core.case.columns import joined
from hpcpic.core.case.gauge import gauge_columns
from hpcpic.core.case.own_functions import arithmetic_fault
from hpcpic.core.case.schema import Fault
from hpcpic.core.simd.own import enter
from hpcpic.plasma.case.config import PlasmaConfig, mode_columns
from hpcpic.plasma.physics.moments import SPEED_SQUARED, VELOCITY, Moment
from hpcpic.plasma.physics.species_fields import field_units

MODES = 8


@dataclass(frozen=True, slots=True)
class SpeciesSample:
    """One species at t = n dt: mass m kg and charge q C of a macro-particle, their number n, sums of moments.

    sample[moment]: in powers of m/s, a number or the three components of a vector, at the time of the positions. In a
    magnetic field numbers are of v-, VELOCITY of the mean of the velocities half a step before and after.
    """

    m: float
    q: float
    n: int
    sums: Mapping[Moment, Any]

    def __getitem__(self, moment: Moment) -> Any:
        return self.sums[moment]


@dataclass(frozen=True, slots=True)
class Sample:
    """What the scalars of one time are made of; field_energy = sum over nodes of (rho + rho_0) phi dV / 2 J;
    modes[n - 1]: amplitude of mode n V/m.
    """

    species: tuple[SpeciesSample, ...]
    field_energy: float
    modes: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Scalar:
    """A column of the series of boxes of at least so many `axes`. Units per unit of what a 1D or 2D box lacks of a
    volume are those of macro-particles. Its value is finite, where a species has no particles (n = 0) too: figures and
    `compare` have no number there else.
    """

    name: str
    unit: str
    value: Callable[[Sample], float]
    moments: tuple[Moment, ...] = ()
    axes: int = 1


def kinetic_energy(sample: Sample) -> float:
    """Sum of m |v|^2 / 2, J."""
    return sum(0.5 * species.m * species[SPEED_SQUARED] for species in sample.species)


def momentum(axis: int, sample: Sample) -> float:
    """Sum of m v along an axis, kg m/s."""
    return float(sum(species.m * species[VELOCITY][axis] for species in sample.species))


def mode(n: int, sample: Sample) -> float:
    """Amplitude of mode n along x, V/m; zero of one that the grid does not have."""
    return sample.modes[n - 1] if n <= len(sample.modes) else 0.0


SCALARS: dict[str, Scalar] = {}  # by name, in the order of the columns


def register(scalar: Scalar) -> None:
    """Make a scalar a column of every series from now on. ValueError where another one has its name, unless its
    function is defined again, and of an integrand that kernels cannot take over, or that mixes axes, whose cells may
    differ.
    """
    for moment in scalar.moments:
        said = arithmetic_fault(moment.integrand)
        if not said and not moment.isotropic:
            said = "its integrand must be made of square, times one component each where it is a vector; of others make"
            said += " a field of species"
        if said:
            raise ValueError(f"scalar {scalar.name!r}: {said}")
    enter(SCALARS, "scalar", scalar.name, scalar, lambda one: one.value)


for column in (
    Scalar("energy_field", "J", lambda sample: sample.field_energy),
    Scalar("energy_kinetic", "J", kinetic_energy, (SPEED_SQUARED,)),
    Scalar("energy_total", "J", lambda sample: sample.field_energy + kinetic_energy(sample), (SPEED_SQUARED,)),
    Scalar("momentum_x", "kg m/s", partial(momentum, 0), (VELOCITY,)),
    Scalar("momentum_y", "kg m/s", partial(momentum, 1), (VELOCITY,)),
    Scalar("momentum_z", "kg m/s", partial(momentum, 2), (VELOCITY,), axes=3),
    Scalar("charge", "C", lambda sample: sum(species.q * species.n for species in sample.species)),
    *(Scalar(f"mode_{n}", "V/m", partial(mode, n)) for n in range(1, MODES + 1)),
):
    register(column)


def faults() -> Iterator[Fault]:
    """Integrands of the user's own that cannot be compiled."""
    for scalar in SCALARS.values():
        for said in filter(None, (moment.fault(vectors=True) for moment in scalar.moments)):
            yield ("output",), f"scalar {scalar.name!r}: {said}"


def columns(dimensions: int) -> tuple[Scalar, ...]:
    """Those that a box of so many dimensions has."""
    return tuple(scalar for scalar in SCALARS.values() if scalar.axes <= dimensions)


def units(config: PlasmaConfig) -> dict[str, str]:
    """Unit of each column of a case's series. Raises ConfigError where two of them have one name."""
    modes = {column: "V/m" for mode in config.output.modes for column in mode_columns(mode)}
    of_scalars = ((f"scalar {scalar.name!r}", {scalar.name: scalar.unit}) for scalar in columns(config.dimensions))
    return joined([("output.modes", modes), *of_scalars, *gauge_columns(config.gauge, field_units(config))])


def moments() -> tuple[Moment, ...]:
    """What the scalars sum over particles, each once."""
    return tuple(dict.fromkeys(moment for scalar in SCALARS.values() for moment in scalar.moments))
