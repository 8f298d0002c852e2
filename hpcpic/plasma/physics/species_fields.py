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
from types import FunctionType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.own_functions import arithmetic_fault, failed_at, place_of
from hpcpic.core.simd.own import enter, files, shipped, taken
from hpcpic.plasma.case.config import PlasmaConfig, name_of, velocity_components
from hpcpic.plasma.physics.moments import SPEED_SQUARED, VELOCITY, Moment


class MeshField(NamedTuple):
    """Unit of a field of all species together; vector: it has a component along each axis of the grid."""

    unit: str
    vector: bool = False


NODES_TRIED = 8  # along each axis, on which a field of the user's own is tried
MESH_FIELDS = {"rho": MeshField("C/m^d"), "phi": MeshField("V"), "E": MeshField("V/m", vector=True)}


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
        if moment not in self.means:
            raise LookupError(f"{moment.integrand.__name__} is none of the moments that the field names")
        return self.means[moment]


@dataclass(frozen=True, slots=True)
class SpeciesField:
    """A field of each species: value(sample) gives [nodes], or of a vector [nodes, components of the velocity].

    "m^d" in the unit: m in 1D, m2 in 2D, m3 in 3D.
    """

    name: str
    unit: str
    value: Callable[[NodeSample], NDArray[np.float64]]
    moments: tuple[Moment, ...] = ()
    vector: bool = False


def unit_in(unit: str, dimensions: int) -> str:
    """The unit in a box of so many dimensions."""
    return unit.replace("m^d", "m" if dimensions == 1 else f"m{dimensions}")


def temperature(sample: NodeSample) -> NDArray[np.float64]:
    """m <|v - u|^2> / (components of v), J. Of N particles at a node it is low by 1/N (check tells)."""
    u = sample[VELOCITY]
    return sample.m / u.shape[-1] * (sample[SPEED_SQUARED] - (u * u).sum(axis=-1))


SPECIES_FIELDS: dict[str, SpeciesField] = {}  # by name


def register(field: SpeciesField) -> None:
    """Let cases name a field in output.fields. ValueError where another one has its name, unless its function is
    defined again, and of an integrand that kernels cannot take over.
    """
    if field.name in MESH_FIELDS:
        raise taken("field", field.name)
    for moment in field.moments:
        if said := arithmetic_fault(moment.integrand):
            raise ValueError(f"field {field.name!r}: {said}")
    enter(SPECIES_FIELDS, "field", field.name, field, lambda one: one.value)


register(SpeciesField("n", "1/m^d", lambda sample: sample.density))
register(SpeciesField("u", "m/s", lambda sample: sample[VELOCITY], (VELOCITY,), vector=True))
register(SpeciesField("T", "J", temperature, (VELOCITY, SPEED_SQUARED)))


def field_units(config: PlasmaConfig) -> dict[str, tuple[str, int]]:
    """Unit and number of components (0: a scalar) of the fields that gauges can read: those of the mesh, and
    <field>_<species>.
    """
    d, components = config.dimensions, velocity_components(config)
    units = {name: (field.unit, d if field.vector else 0) for name, field in MESH_FIELDS.items()}
    for i, species in enumerate(config.species):
        for field in SPECIES_FIELDS.values():
            units[f"{field.name}_{name_of(species, i)}"] = field.unit, components if field.vector else 0
    return {name: (unit_in(unit, d), n) for name, (unit, n) in units.items()}


def asked_for(config: PlasmaConfig) -> list[SpeciesField]:
    """The fields of species that snapshots or gauges of a case show."""
    names = {*config.output.fields, *(gauge.what for gauge in config.gauge)}
    species = [name_of(species, i) for i, species in enumerate(config.species)]
    return [f for f in SPECIES_FIELDS.values() if {f.name, *(f"{f.name}_{one}" for one in species)} & names]


def fault(field: SpeciesField, dimensions: int, components: int) -> str:
    """What is wrong with a field of the user's own, in one sentence with its place: its integrands, or what it makes of
    a sample, here of a few nodes; "" of a sound one. components: of the velocity.
    """
    if said := next(filter(None, (moment.fault(vectors=False) for moment in field.moments)), ""):
        return said
    if shipped(field.value):
        return ""
    nodes = (NODES_TRIED,) * dimensions
    means = {moment: np.ones((*nodes, components) if moment.vector else nodes) for moment in field.moments}
    try:
        with np.errstate(all="ignore"):
            value = np.asarray(field.value(NodeSample(1.0, np.ones(nodes), means)))
    except Exception as error:
        return f"{failed_at(error, files) or field.name}: {type(error).__name__}: {error}"
    wanted = (*nodes, components) if field.vector else nodes
    if value.shape == wanted and value.dtype.kind in "iuf":
        return ""
    place = f"{place_of(field.value)}: " if isinstance(field.value, FunctionType) else ""
    given, asked = (f"[{', '.join(map(str, shape))}]" for shape in (value.shape, wanted))
    return f"{place}must return numbers {asked} for a sample of {list(nodes)} nodes (it returns {value.dtype} {given})"
