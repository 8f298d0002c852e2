"""Fields of one species on the nodes of the grid: what its particles have in common at a place.

Another one is a name, a unit and a function of a sample, registered; a case then names it in output.fields. What it
takes the mean of is a Moment, whose integrand is written once:

    def square_along_x(vx, vy, vz, square):
        return vx * vx

    ALONG_X = Moment(square_along_x, power=2)

    def temperature_x(sample):
        return sample.m * (sample[ALONG_X] - sample[VELOCITY][..., 0] ** 2)

    register(SpeciesField("T_x", "J", temperature_x, (ALONG_X, VELOCITY)))
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hpcpic.plasma.physics.moments import SPEED_SQUARED, VELOCITY, Moment

MESH_FIELDS = ("rho", "phi", "E")  # of all species together


@dataclass(frozen=True, slots=True)
class NodeSample:
    """One species at t = n dt: mass m kg of a real particle, density[nodes] of real particles per m^d, d dimensions.

    sample[moment]: mean over the particles at a node, weighted by their shape as their charge is; in powers of m/s,
    [nodes] or, of a vector, [nodes, components of the velocity]; 0 where there is no particle.
    """

    m: float
    density: NDArray[np.float64]
    means: Mapping[Moment, NDArray[np.float64]]

    def __getitem__(self, moment: Moment) -> NDArray[np.float64]:
        return self.means[moment]


@dataclass(frozen=True, slots=True)
class SpeciesField:
    """A field of each species: value(sample) gives [nodes], or of a vector [nodes, components of the velocity].

    "m^d" in the unit: m in 1D, m2 in 2D.
    """

    name: str
    unit: str
    value: Callable[[NodeSample], NDArray[np.float64]]
    moments: tuple[Moment, ...] = ()
    vector: bool = False

    def unit_in(self, dimensions: int) -> str:
        """The unit in a box of so many dimensions."""
        return self.unit.replace("m^d", "m" if dimensions == 1 else f"m{dimensions}")


def temperature(sample: NodeSample) -> NDArray[np.float64]:
    """m <|v - u|^2> / (components of v), J. Of N particles at a node it is low by about 1/N."""
    u = sample[VELOCITY]
    return sample.m / u.shape[-1] * (sample[SPEED_SQUARED] - (u * u).sum(axis=-1))


SPECIES_FIELDS: dict[str, SpeciesField] = {}  # by name


def register(field: SpeciesField) -> None:
    """Let cases name a field in output.fields."""
    SPECIES_FIELDS[field.name] = field


register(SpeciesField("n", "1/m^d", lambda sample: sample.density))
register(SpeciesField("u", "m/s", lambda sample: sample[VELOCITY], (VELOCITY,), vector=True))
register(SpeciesField("T", "J", temperature, (VELOCITY, SPEED_SQUARED)))


def asked_for(names: tuple[str, ...]) -> list[SpeciesField]:
    """The fields of species among the names in output.fields."""
    return [SPECIES_FIELDS[name] for name in names if name in SPECIES_FIELDS]
