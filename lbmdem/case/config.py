"""What a case says, in physical units; vectors are in physical order (x, y, z), 2D cases have x and y.

Lattice units appear only in `check` and inside the program.
"""

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from hpcpic.core.case.accelerations import MEANING
from hpcpic.core.case.config import Tree
from hpcpic.core.case.gauge import Gauge
from hpcpic.core.case.schema import REQUIRED, Lengths, Points, Section, Vector, as_tuple, setting
from hpcpic.core.case.words import one_of, one_period, one_viscosity
from hpcpic.core.files.start import Start, attach_arrays
from hpcpic.core.physics.contact_law import SHEAR_RATIO, ContactLaw, stable_step
from lbmdem.case.boundaries import Boundary, Obstacle
from lbmdem.case.grain_arrays import given

AXES = "xyz"
ACCURATE = 0.2  # of the largest stable step of the contacts, for their accuracy
Positive = Annotated[float, Field(gt=0)]
Names = Annotated[tuple[Literal["x", "y", "z"], ...], BeforeValidator(as_tuple)]


class Simulation(Section):
    dimensions: Literal[2, 3] | None = setting(None, "2 or 3; by default as many as domain.size has")
    lattice: Literal["D2Q9", "D3Q19"] | None = setting(None, "velocities of the lattice; by default those of 2D or 3D")
    end_time: float = setting(REQUIRED, "time at which the run ends", "s", ge=0)
    time_step: float | None = setting(
        None, "time step of a case without fluid, by default a fifth of the limit of stability", "s", gt=0
    )
    blocks: int = setting(0, "task blocks per rank, 0 = automatic", ge=0)
    random_seed: int = setting(1, "seed of the packings", ge=0)


class DomainSection(Section):
    instead = dict.fromkeys(("low", "high"), "the box begins at the origin: size = [Lx, Ly]")
    size: Lengths = setting(REQUIRED, "size of the box, [Lx, Ly] or [Lx, Ly, Lz]", "m", min_length=2, max_length=3)
    spacing: float | None = setting(None, "distance of the lattice nodes; no meaning without fluid", "m", gt=0)
    periodic: Names = setting((), "axes along which the box repeats")


class Initial(Section):
    flow: Literal["taylor-green", "shear-layer"] = setting(REQUIRED, "velocity field at the start")
    speed: float = setting(REQUIRED, "its largest velocity", "m/s", gt=0)


class FluidSection(Section):
    instead = dict.fromkeys(("gravity",), "body_force drives a fluid; gravity, outside of all groups, is of its grains")
    density: float = setting(1000.0, "density", "kg/m3", gt=0)
    kinematic_viscosity: float = setting(
        REQUIRED, "kinematic viscosity; dynamic_viscosity in Pa s is understood too, over density", "m2/s", gt=0
    )
    relaxation_time: float | None = setting(
        None, "tau, by default 1; gives the time step dt = (tau - 1/2)/3 dx^2/nu", gt=0.5
    )
    time_step: float | None = setting(None, "time step, instead of relaxation_time", "s", gt=0)
    collision: Literal["BGK", "TRT", "central"] = setting(
        "TRT",
        "one relaxation time (the paper), two, or central moments: stable as tau goes to 1/2, with a bulk "
        "viscosity of dx^2/(6 dt), so that at tau = 0.6 they damp sound 3 times as fast",
    )
    magic: float = setting(3.0 / 16.0, "TRT: (tau+ - 1/2)(tau- - 1/2); 3/16 puts walls half-way exactly", gt=0)
    storage: Literal["double", "single"] = setting("double", "type in which populations are kept")
    body_force: Vector = setting(
        (), "acceleration a by a pressure gradient -density a, which pushes moving grains too [ax, ay(, az)]", "m/s2"
    )
    initial: Initial | None = None
    start: Start | None = None


class Diameters(Section):
    law: Literal["beta"] = setting("beta", "cumulative beta distribution (Voivret et al. 2007)")
    min: Positive = setting(REQUIRED, "smallest diameter", "m")
    max: Positive = setting(REQUIRED, "largest diameter", "m")
    a: Positive = setting(1.0, "first shape parameter")
    b: Positive = setting(1.0, "second shape parameter")
    count: int = setting(REQUIRED, "number of grains", ge=1)


class Packing(Section):
    porosity: float | None = setting(
        None,
        "void fraction asked for, of grains that touch and bear no weight; by default what settling gives: grains at "
        "rest, but without friction, and between rigid sides not the stresses of a silo (check, run's log)",
        gt=0,
        lt=1,
    )
    low: float = setting(0.0, "lower end of the sample along the last axis: a screen for grains that move", "m")
    high: float | None = setting(None, "upper end; by default the height that the porosity gives", "m")


class GrainSet(Section):
    instead = dict.fromkeys(("radius", "radii"), "diameter is twice that")
    name: str = setting("", "name in the output; by default grains_1, ...")
    shape: Literal["disc", "sphere"] | None = setting(None, "by default discs in 2D, spheres in 3D")
    diameter: float | None = setting(None, "of all grains of the set", "m", gt=0)
    diameters: Diameters | None = None
    density: float = setting(2650.0, "density of the material", "kg/m3", gt=0)
    position: Points = setting((), "of the centres: one vector, or a list of them", "m")
    packing: Packing | None = None
    moving: bool = setting(True, "false: fixed in space")
    velocity: Vector = setting((), "at the start; of fixed grains that of their surface, always", "m/s")
    angular_velocity: Vector = setting((), "[wz] in 2D, [wx, wy, wz] in 3D", "rad/s")
    start: Start | None = None
    acceleration: str = setting("", MEANING, "m/s2")

    @property
    def law(self) -> Diameters:
        """The law of diameters of a set that has no single diameter."""
        assert self.diameters is not None
        return self.diameters

    def given(self, name: str) -> np.ndarray | None:
        """An array that the set starts with; None where the case names none."""
        return given(self.start, self.shape, name)

    @property
    def centres(self) -> np.ndarray | tuple[tuple[float, ...], ...]:
        """Positions [n, d] as given, m; none of a packing."""
        given = self.given("position")
        return self.position if given is None else given

    @property
    def own_diameters(self) -> np.ndarray | None:
        """Diameters [n] of grains that are given or all alike, m; None under a law of diameters."""
        if self.diameter is not None:
            return np.full(max(len(self.centres), 1), self.diameter)
        return self.given("diameter")

    def at_start(self, name: Literal["velocity", "angular_velocity"]) -> np.ndarray:
        """Velocities [n, k] at the start, m/s or rad/s; one row where all grains have the same."""
        return np.array([getattr(self, name)] if (rows := self.given(name)) is None else rows, np.float64)

    @property
    def smallest_diameter(self) -> float:
        """Diameter of the smallest grain, m."""
        own = self.own_diameters
        return self.law.min if own is None else float(own.min())

    @property
    def largest_diameter(self) -> float:
        """Diameter of the largest grain, m."""
        own = self.own_diameters
        return self.law.max if own is None else float(own.max())

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.centres) or self.law.count


class Contact(Section):
    instead = (
        {"restitution": "damping = 0.05, 0.1, 0.2, 0.3 gives 0.85, 0.73, 0.53, 0.37: exp(-pi alpha/sqrt(1 - alpha^2))"}
        | dict.fromkeys(("rolling_friction", "rolling_resistance"), "there is none: heaps are those of round grains")
        | dict.fromkeys(("youngs_modulus", "poisson_ratio"), "contacts are linear springs: normal_stiffness in N/m")
    )
    normal_stiffness: float = setting(1.0e4, "k_n", "N/m", gt=0)
    damping: float = setting(0.2, "alpha, of the critical damping of a pair", ge=0, lt=1)
    tangential: Literal["regularised", "history"] = setting(
        "regularised", "Coulomb friction smoothed by a viscosity (the paper), or by a spring that remembers"
    )
    tangential_viscosity: float | None = setting(
        None, "beta; by default sqrt(m k_n), or 2 alpha sqrt(m k_t) beside a spring (m: lightest pair)", "N s/m", ge=0
    )
    tangential_stiffness: float | None = setting(None, "by default 2/7 of the normal one", "N/m", gt=0)
    friction: float = setting(0.5, "mu_f", ge=0)


class Coupling(Section):
    bounce_back: str = setting(
        "cli",
        "wall rule: cli (parametrised linear), interpolated (Bouzidi's linear [6]), quadratic (Bouzidi's), "
        "halfway, or one of your own",
    )
    refill: Literal["average", "local", "non-equilibrium", "mass-conserving", "conserving"] | None = setting(
        None,
        "populations of uncovered nodes: equilibrium with the mean density (average, the paper) or the "
        "neighbours'. In a closed box average, local and non-equilibrium lose mass (measured: 1.4e-3 in 2 s, 1e-2 in "
        "0.3 s); mass-conserving is local and gives it back evenly; conserving counts momentum too, by whole nodes, "
        "which slows a grain that a stream carries by 1 to 3 % and turns it. By default mass-conserving where grains "
        "move in a closed or periodic box, else local",
    )
    substeps: int = setting(
        0, "DEM steps in a fluid step, 0 = from the stability limits of contacts and, step by step, of films", ge=0
    )
    inertia: Literal["implicit", "explicit"] = setting(
        "implicit", "grains lighter than the impedance of their links are slowed down to be stable, or none (the paper)"
    )
    lubrication: bool = setting(True, "forces of gaps that the lattice does not resolve")
    frozen: bool = setting(False, "the fluid sees the grains where they were at the start")

    @property
    def keeps_mass(self) -> bool:
        """True where what the fluid loses to grains that move is given back to it."""
        return self.refill in ("mass-conserving", "conserving")


class Shaking(Section):
    acceleration: Vector = setting(
        REQUIRED,
        "amplitude a of the acceleration a sin(2 pi f t) of the frame, in which all is told: fluid and grains that "
        "move are pushed by -a sin(2 pi f t)",
        "m/s2",
    )
    frequency: float = setting(REQUIRED, "cycles per second", "1/s", gt=0)


class Period(Section):
    series: float | None = setting(
        0.0, "time between samples of the series, 0 = 20 to 100 in all that cost 5 %", "s", ge=0
    )
    fields: float | None = setting(0.0, "time between snapshots of the fluid, 0 = never", "s", ge=0)
    grains: float | None = setting(0.0, "time between snapshots of the grains, 0 = never", "s", ge=0)
    checkpoint: float | None = setting(
        0.0, "time between checkpoints, 0 = only at the end and at an early stop", "s", ge=0
    )


class Every(Section):
    series: int | None = setting(None, "steps between samples of the series, instead of period.series", "steps", ge=0)
    fields: int | None = setting(None, "steps between snapshots of the fluid", "steps", ge=0)
    grains: int | None = setting(None, "steps between snapshots of the grains", "steps", ge=0)
    checkpoint: int | None = setting(None, "steps between checkpoints", "steps", ge=0)


class Output(Section):
    path: str | None = setting(None, "run folder, when the command line names none")
    period: Period = Period()
    every: Every = Every()
    pictures: Vector = setting(
        (), "times of the pictures of `plot grains` besides the first; by default six, evenly", "s"
    )
    stress_slices: int = setting(0, "control slices along the last axis, for the stress between grains", ge=0)


class LbmDemConfig(Section):
    """A whole LBM-DEM case."""

    rewritten: ClassVar[tuple[str, ...]] = ("fluid.dynamic_viscosity",)
    largest = 1e20  # up to four lengths, a density and a stiffness are multiplied, and squared

    description: str = setting("", "one sentence")
    simulation: Simulation
    domain: DomainSection
    fluid: FluidSection | None = None
    boundary: tuple[Boundary, ...] = ()
    obstacle: tuple[Obstacle, ...] = ()
    grains: tuple[GrainSet, ...] = ()
    contact: Contact = Contact()
    coupling: Coupling = Coupling()
    gravity: Vector = setting((), "acceleration of gravity [gx, gy(, gz)]", "m/s2")
    shaking: Shaking | None = None
    gauge: tuple[Gauge, ...] = ()
    output: Output = Output()

    @property
    def dimensions(self) -> int:
        return self.simulation.dimensions or len(self.domain.size)

    @property
    def fields(self) -> dict[str, tuple[str, int]]:
        """Unit and number of components (0: a scalar) of each field of the fluid."""
        return {"velocity": ("m/s", self.dimensions), "pressure": ("Pa", 0)} if self.fluid else {}

    @property
    def lattice(self) -> str:
        """Name of the velocity set."""
        return self.simulation.lattice or ("D2Q9" if self.dimensions == 2 else "D3Q19")

    @property
    def liquid(self) -> FluidSection:
        """The fluid of a case that has one."""
        assert self.fluid is not None
        return self.fluid

    @property
    def spacing(self) -> float:
        """Distance of the nodes, m; without fluid the size of the rows that slabs are cut into."""
        if self.domain.spacing is not None:
            return self.domain.spacing
        return max((grains.largest_diameter for grains in self.grains), default=max(self.domain.size))

    @property
    def time_step(self) -> float:
        """dt [s]: as given, of tau by [5], or without fluid of the contacts."""
        fluid = self.fluid
        if fluid is None:
            return self.simulation.time_step or ACCURATE * contact_step(self)
        if fluid.time_step is not None:
            return fluid.time_step
        return (self.tau - 0.5) / 3.0 * self.spacing**2 / fluid.kinematic_viscosity

    @property
    def tau(self) -> float:
        """The relaxation time [5], in steps."""
        fluid = self.liquid
        if fluid.time_step is None:
            return 1.0 if fluid.relaxation_time is None else fluid.relaxation_time
        return 0.5 + 3.0 * fluid.kinematic_viscosity * fluid.time_step / self.spacing**2

    @property
    def points(self) -> tuple[int, ...]:
        """Nodes along x, y(, z); they sit half a spacing inside the faces."""
        return tuple(max(1, round(length / self.spacing)) for length in self.domain.size)

    def walled(self, k: int) -> tuple[int, ...]:
        """Axes across the axis k that end at walls on both sides."""
        return tuple(j for j, axis in enumerate(AXES[: self.dimensions]) if j != k and axis not in self.unwalled)

    @property
    def grains_move(self) -> bool:
        return any(grains.moving for grains in self.grains)

    @property
    def unwalled(self) -> set[str]:
        """Axes along which fluid may pass an end of the box."""
        return {face.face[0] for face in self.boundary if face.is_open}.union(self.domain.periodic)

    @property
    def substeps(self) -> int:
        """n_d: steps of the contacts in one of the fluid."""
        wanted = self.time_step / (ACCURATE * contact_step(self))
        return self.coupling.substeps or max(1, math.ceil(wanted * (1 - 1e-12)))

    @property
    def n_steps(self) -> int:
        return math.ceil(self.simulation.end_time / self.time_step * (1 - 1e-12))

    @property
    def end_time(self) -> float:
        """Time of the last step, s."""
        return self.n_steps * self.time_step

    @property
    def conserved(self) -> tuple[str, ...]:
        """Scalars of the series that the scene keeps: in closed faces the mass, or the mean density where grains that
        move change the number of nodes; momentum where nothing acts.
        """
        closed = not any(face.is_open for face in self.boundary)
        alone = self.fluid is not None and not (self.grains or self.obstacle or self.shaking)
        alone = alone and len(self.domain.periodic) == self.dimensions
        free = (axis for axis, force in zip(AXES, self.liquid.body_force) if not force) if alone else ()
        mass = "mean_density" if self.fluid and self.grains_move else "mass"
        return (*((mass,) if closed else ()), *(f"momentum_{axis}" for axis in free))

    @classmethod
    def modernised(cls, tree: Tree) -> None:
        fluids = [("fluid",)] if isinstance(tree.data.get("fluid"), dict) else []
        one_viscosity(tree, fluids, "kinematic_viscosity", FluidSection.model_fields["density"].default)
        one_period(tree, Period.model_fields)
        one_of(tree, [("fluid", word) for word in ("relaxation_time", "time_step")])
        attach_arrays(tree, ("fluid", "start"))
        attach_arrays(tree, ("grains", "start"))


def whole(cells: float) -> bool:
    """True for a number of spacings along a side that a box may have."""
    return round(cells) >= 1 and abs(cells - round(cells)) <= 1e-6 * max(1.0, cells)


def whole_spacing(size: Vector, most: float) -> float:
    """The largest spacing (m), not above `most` and not far below, of which all sides hold a whole number; else 0."""
    first = max(1, math.ceil(size[0] / most * (1 - 1e-9)))
    near = (size[0] / n for n in range(first, 3 * first // 2 + 2))
    return next((dx for dx in near if all(whole(length / dx) for length in size)), 0.0)


def grain_mass(grains: GrainSet, diameter: float, d: int) -> float:
    """kg; of a disc per metre of depth."""
    return grains.density * math.pi / (4.0 if d == 2 else 6.0) * diameter**d


def lightest(config: LbmDemConfig) -> float:
    """Mass of the lightest grain that moves, kg."""
    d = config.dimensions
    masses = [grain_mass(grains, grains.smallest_diameter, d) for grains in config.grains if grains.moving]
    return min(masses, default=math.inf)


def seeps(config: LbmDemConfig) -> bool:
    """True when something drives a flow along the last axis through grains at rest, so that they have a
    permeability."""
    ends = [face for face in config.boundary if face.face[0] == AXES[config.dimensions - 1] and face.type == "pressure"]
    still = config.coupling.frozen or not config.grains_move
    driven = len(ends) == 2 or (config.fluid is not None and bool(config.liquid.body_force[-1]))
    return bool(config.fluid and config.grains and still and driven)


def contact_law(config: LbmDemConfig) -> ContactLaw:
    contact, reduced = config.contact, 0.5 * lightest(config)
    if not contact.friction:  # nothing acts along a contact, nor limits its step
        return ContactLaw(contact.normal_stiffness, contact.damping)
    shear = contact.tangential_stiffness or SHEAR_RATIO * contact.normal_stiffness
    remembers = contact.tangential == "history"
    beta = contact.tangential_viscosity
    if beta is None and math.isfinite(reduced):
        dashpot = 2.0 * contact.damping * math.sqrt(shear) if remembers else math.sqrt(contact.normal_stiffness)
        beta = dashpot * math.sqrt(reduced)
    return ContactLaw(
        stiffness=contact.normal_stiffness,
        damping=contact.damping,
        friction=contact.friction,
        viscosity=beta or 0.0,
        shear=shear if remembers else 0.0,
    )


def contact_step(config: LbmDemConfig) -> float:
    """The largest stable step of the grains that move, s; infinite when none does."""
    d = config.dimensions
    moving = [grains for grains in config.grains if grains.moving]
    diameters = np.array([grains.smallest_diameter for grains in moving])
    mass = np.array([grain_mass(grains, grains.smallest_diameter, d) for grains in moving])
    inertia = (0.5 if d == 2 else 0.4) * mass * (0.5 * diameters) ** 2
    return stable_step(contact_law(config), 0.5 * diameters, mass, inertia)
