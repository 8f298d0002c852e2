"""What an SPH case says, as a typed, frozen configuration. SI units; vectors are in physical order (x, y(, z)).

What other settings determine (sound speed, Courant number, domain, kind of viscosity) is filled in by setup.defaults.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from hpcpic.core.case.accelerations import MEANING
from hpcpic.core.case.config import Tree
from hpcpic.core.case.schema import REQUIRED, Filled, Section, Vector, matching, setting
from hpcpic.core.case.words import one_of, one_period, one_viscosity
from hpcpic.core.files.start import Start, attach, attach_arrays, attached_arrays
from sph.case.bodies import Body, Names
from sph.case.motions import Motion
from sph.case.openings import Direction, Inlet, Opening, Outlet
from sph.case.shapes import Shape

Integrator = Literal["euler", "predictor-corrector", "rk3-tvd", "symplectic"]
Flux = Literal["none", "rusanov", "molteni", "fourtakas", "delta"]
WallType = Literal[
    "mirror-no-slip", "point-symmetric-free-slip", "repulsive", "pressure-continuity", "extrapolated-free-slip",
    "extrapolated-no-slip",
]  # fmt: skip
AXES = ("x", "y", "z")


class Simulation(Section):
    dimensions: Filled[Literal[2, 3]] = setting(None, "2 or 3; by default as many as the corners of shapes have")
    end_time: float = setting(REQUIRED, "physical time to reach", "s", ge=0)
    integrator: Integrator = setting(
        "symplectic",
        "explicit Euler, the predictor-corrector (SC 11-12), TVD Runge-Kutta of third order, or split symplectic: "
        "velocity first, then density with the new velocity",
    )
    cfl: float | None = setting(
        None, "time step over h / c0 (the acoustic criterion); by default 0.6 of the stability limit", gt=0
    )
    time_step: float | None = setting(None, "fixed time step; by default it adapts", "s", gt=0)
    random_seed: int = setting(0, "seed of the disorder of fluids", ge=0)


class Domain(Section):
    instead = dict.fromkeys(("size", "length", "lengths"), "the corners are low = [0.0, 0.0] and high = [Lx, Ly]")
    low: Vector | None = setting(None, "lower corner; by default that of fluids and walls", "m")
    high: Vector | None = setting(None, "upper corner; by default that of fluids and walls", "m")
    periodic: Names = setting((), "axes along which the domain repeats itself, of x, y, z")
    outflow: Names = setting((), 'sides through which fluid leaves for good, as "x+"; elsewhere it may come back')

    @property
    def corners(self) -> tuple[Vector, Vector]:
        """Lower and upper corner, m, of a completed case or one that gives both."""
        assert self.low is not None and self.high is not None
        return self.low, self.high


class Flow(Section):
    type: Literal["linear", "taylor-green", "standing-wave"] = setting(
        REQUIRED,
        "v = G (x - centre); vortices in a periodic box; the velocity of a standing wave on the surface of a fluid, or "
        "on the interface of two that both have this flow",
    )
    gradient: Vector = setting((), "linear: G row by row", "1/s")
    centre: Vector = setting((), "linear: where the velocity is zero; by default the middle of the shape", "m")
    amplitude: float = setting(0.0, "taylor-green: largest velocity in m/s; standing-wave: of the surface in m")
    wavelength: float = setting(1.0, "of vortices or wave", "m", gt=0)


class Fluid(Section):
    name: str = setting("", "by default fluid_1, fluid_2, ...")
    shape: Shape
    density: float = setting(1000.0, "density of rest", "kg/m3", gt=0)
    dynamic_viscosity: float = setting(
        0.0, "dynamic viscosity; kinematic_viscosity in m2/s is understood too, times density", "Pa s", ge=0
    )
    gas: bool = setting(False, "air beside liquids: p + p_a = p_a (rho/density)^1.4, p_a = eos.ambient_pressure")
    initial_pressure: Literal["zero", "hydrostatic", "flow"] = setting(
        "hydrostatic",
        "at t = 0: none, as in a drop that falls, that of rest (under gravity, else that of the outlets), or the one "
        "that goes with `flow`",
    )
    surface: float | None = setting(
        None,
        "hydrostatic: height of the free surface; by default the upper side of the shape, or of the arrays, which may "
        "slope",
        "m",
    )
    velocity: Vector = setting((), "uniform initial velocity", "m/s")
    flow: Flow | None = None
    start: Start | None = None
    acceleration: str = setting("", MEANING, "m/s2")
    disorder: float = setting(
        0.0,
        "particles start off their lattice by up to this share of the spacing along each axis; those of a liquid "
        "that stays at rest under gravity are evened out then, which leaves half of it",
        ge=0,
        le=0.25,
    )
    thin_layer: Literal["refuse", "one layer"] = setting(
        "refuse", "a box thinner than the spacing: refuse it, or fill it with one layer of reduced mass"
    )


class Eos(Section):
    sound_speed: float | None = setting(None, "c0", "m/s", gt=0)
    sound_speed_factor: float = setting(10.0, "c0 / max_velocity where sound_speed is not given", gt=0)
    max_velocity: float | None = setting(
        None,
        "largest velocity to expect; by default the largest of sqrt(2 g H), fluids and bodies at t = 0, inlets and "
        "walls that swing. Other walls that move count without gravity only: a gate need not push fluid",
        "m/s",
        gt=0,
    )
    gamma: float = setting(7.0, "exponent of the equation of state (MP 14)", ge=1)
    background_pressure: float | None = setting(
        None, "added to every pressure: keeps particles apart where there is no free surface; by default 0, or where "
        "gases lie on all liquids 0.05 rho max_velocity^2", "Pa", ge=0,
    )  # fmt: skip
    ambient_pressure: float = setting(
        101325.0, "absolute pressure of gases at rest, where the pressure of the series is 0", "Pa", gt=0
    )


class Numerics(Section):
    spacing: float = setting(REQUIRED, "particle spacing dp", "m", gt=0)
    smoothing: float = setting(1.5, "smoothing length over spacing, h / dp", gt=0, le=10)
    kernel: str = setting(
        "wendland2",
        "cubic (spline, MP 9), quintic (spline, reaches 3 h), wendland2 (C2), wendland4 (C4), or one of your own",
    )
    gradient_correction: bool = setting(False, "renormalised gradients: exact for linear fields")
    continuity: Literal["volumes", "masses"] = setting(
        "volumes", "rate of density with rho_i V_j of each neighbour (MP 16), or with its mass (SC 3)"
    )
    density_flux: Flux = setting(
        "delta", "diffusion of density: Rusanov (MP 17), Molteni, Fourtakas, or delta-SPH with renormalised gradient"
    )
    flux_coefficient: float | None = setting(None, "of the flux; by default 1 (rusanov) or 0.1", ge=0, le=100)
    viscosity_form: Literal["none", "strain-rate", "cleary", "morris", "full-stress", "artificial"] | None = setting(
        None,
        "Morris et al. 1997; full-stress: with (grad v)^T too, which free surfaces feel; strain rate and stress "
        "(MP 22-23); Cleary (SC 6), exact for shear along a lattice and 6 to 40 % too viscous elsewhere; or artificial "
        "only. By default full-stress for viscous liquids with a free surface, morris for others, else artificial",
    )
    artificial_viscosity: float | None = setting(
        None,
        "alpha of the artificial viscosity, added to any form; by default 0.02 for artificial, else 0",
        ge=0,
        le=100,
    )
    tensile_correction: float = setting(0.0, "Monaghan's artificial pressure against clumping, 0.2 is usual", ge=0)
    shifting: bool | None = setting(
        None,
        "particles are shifted towards where there are few (Sun et al. 2017), and their densities know it; by default "
        "with the viscosity of Morris or the full stress in one fluid, with the symplectic integrator and without "
        "gradient_correction",
    )
    precision: Literal["double", "single"] = setting("double", "arithmetic of the pair sums")
    balance_period: int = setting(100, "steps between looks at the load of the ranks, 0 = never", "steps", ge=0)
    reproducible: Literal[True] = setting(True, "same bits for any ranks, threads and task blocks")


class Wall(Section):
    name: str = setting("", "by default wall_1, wall_2, ...")
    shape: Shape
    type: WallType | None = setting(
        None,
        "how it acts; by default extrapolated from the fluid: with no slip if the case follows the viscosity of its "
        "fluid, else with free slip",
    )
    solid: bool = setting(False, "the fluid is outside of the shape; by default it is inside, as in a tank")
    motion: Motion | None = None
    body: Body | None = None
    measure_force: bool = setting(False, "force, torque and impulse of the fluid go into the series")
    torque_about: Vector = setting((), "point of the torque; by default the middle of the shape", "m")


@dataclass(frozen=True)
class GaugeKind:
    """units: of a reading in 2D and 3D. vector: it reads a component along each axis. at_point: of the fluid there.
    column: of the fluid above and below its place, all along the vertical.

    along: it has an axis, or needs one (`needs_axis`; `axis`: by default). area: it has an extent.
    """

    units: tuple[str, str]
    vector: bool = False
    at_point: bool = False
    column: bool = False
    along: bool = True
    needs_axis: bool = False
    axis: str | None = None
    area: bool = False


PRESSURE = GaugeKind(("Pa", "Pa"), at_point=True, along=False)
WALL_PRESSURE = GaugeKind(("Pa", "Pa"), needs_axis=True, area=True)
VELOCITY = GaugeKind(("m/s", "m/s"), vector=True, at_point=True, along=False)
ELEVATION = GaugeKind(("m", "m"), column=True)
FRONT = GaugeKind(("m", "m"), axis="x+")
FLOW = GaugeKind(("m2/s", "m3/s"), needs_axis=True, area=True)
GAUGES = {
    "pressure": PRESSURE, "wall-pressure": WALL_PRESSURE, "velocity": VELOCITY, "elevation": ELEVATION, "front": FRONT,
    "flow": FLOW,
}  # fmt: skip


class Gauge(Section):
    name: str = setting("", "by default gauge_1, gauge_2, ...")
    what: Literal["pressure", "wall-pressure", "velocity", "elevation", "front", "flow"] = setting(
        REQUIRED,
        "pressure or velocity at a point of the fluid, mean pressure on an area of wall since the last sample, height "
        "of the surface above a point or of the bed where it is dry, farthest fluid along an axis (spray and what has "
        "left a tank too), volume per time through a section",
    )
    at: Vector = setting((), "the point; wall-pressure and flow: the middle of the area or section", "m")
    axis: Direction | None = setting(
        None,
        "front: the direction, by default x+; flow: normal of the section; elevation: up; wall-pressure: the way in "
        "which fluid pushes the wall, or the axis nearest to it: the area lies in the wall, and its pressure acts "
        "along the normal",
    )
    size: Vector = setting(
        (),
        "flow: extent of the section along each axis, 0 or none: as far as fluid goes; wall-pressure: of a rectangle "
        "(in 2D a strip), 0: one spacing",
        "m",
    )
    radius: float | None = setting(None, "wall-pressure: of a disc (in 2D a strip twice as long)", "m", gt=0)
    fluid: str = setting("", "elevation: of this fluid alone; by default of all but gases")
    wall: str = setting("", "wall-pressure: the wall that it sits in and moves with; by default any, at one place")
    period: float | None = setting(None, "of the samples; by default that of the series", "s", gt=0)

    @property
    def kind(self) -> GaugeKind:
        return GAUGES[self.what]

    @property
    def direction(self) -> tuple[int, float]:
        """Number of the axis, and 1 or -1 for the way along it."""
        assert self.axis is not None
        return AXES.index(self.axis[0]), 1.0 if self.axis[1] == "+" else -1.0

    def extents(self, spacing: float) -> list[float]:
        """Extent of an area of wall along each axis, m; 0 along its normal, a spacing where nothing is said."""
        size = self.size or (0.0,) * len(self.at)
        return [0.0 if k == self.direction[0] else extent or spacing for k, extent in enumerate(size)]

    def area(self, spacing: float) -> float:
        """Area of a piece of wall, m2 (2D: length of a strip, m). The edge of a disc is soft, a spacing wide."""
        if self.radius:
            outer, solid = self.radius + spacing / 2, len(self.at) == 3
            if self.radius < spacing / 2:
                return math.pi * outer**3 / (3 * spacing) if solid else outer**2 / spacing
            return math.pi * (self.radius**2 + spacing**2 / 12) if solid else 2 * self.radius
        return math.prod(extent for extent in self.extents(spacing) if extent)


class Period(Section):
    series: float | None = setting(0.01, "time between samples of the series, 0 = never", "s", ge=0)
    particles: float | None = setting(0.0, "time between snapshots of the particles, 0 = never", "s", ge=0)
    checkpoint: float | None = setting(0.0, "time between checkpoints, 0 = by wall time", "s", ge=0)


class Every(Section):
    series: int | None = setting(None, "steps between samples of the series, instead of period.series", "steps", ge=0)
    particles: int | None = setting(None, "steps between snapshots of the particles", "steps", ge=0)
    checkpoint: int | None = setting(None, "steps between checkpoints", "steps", ge=0)


class Output(Section):
    path: str | None = setting(None, "run folder, when the command line names none")
    period: Period = Period()
    every: Every = Every()
    walls: bool = setting(True, "snapshots hold the particles of walls too")
    moments: bool = setting(False, "snapshots hold the discrete moments of W and of its gradient (MP 12, 13)")
    pictures: Vector = setting(
        (), "times of the pictures of `plot sequence` besides the first; by default six, evenly", "s"
    )


class SphConfig(Section):
    """A whole SPH case."""

    rewritten: ClassVar[tuple[str, ...]] = ("fluid[].kinematic_viscosity",)
    largest = 1e40  # products of a few stay in floating point

    description: str = setting("", "one sentence")
    simulation: Simulation
    domain: Domain = Domain()
    fluid: tuple[Fluid, ...] = ()
    eos: Eos = Eos()
    numerics: Numerics
    gravity: Vector = setting((), "acceleration of gravity", "m/s2")
    body_force: Vector = setting((), "further acceleration of the fluid", "m/s2")
    wall: tuple[Wall, ...] = ()
    gauge: tuple[Gauge, ...] = ()
    inlet: tuple[Inlet, ...] = ()
    outlet: tuple[Outlet, ...] = ()
    output: Output = Output()

    @property
    def dimensions(self) -> int:
        """Those that the case gives, else those of its first shape."""
        given = (shape.dimensions for shape in shapes_of(self))
        return self.simulation.dimensions or next((d for d in given if d in (2, 3)), 2)

    @property
    def h(self) -> float:
        """Smoothing length, m."""
        return self.numerics.smoothing * self.numerics.spacing

    @property
    def sound_speed(self) -> float:
        assert self.eos.sound_speed is not None  # completed
        return self.eos.sound_speed

    @property
    def n_steps(self) -> None:
        """A run ends at a time, after a number of steps that nobody knows before."""
        return None

    @property
    def end_time(self) -> float:
        """Physical time to reach, s."""
        return self.simulation.end_time

    @property
    def sensors(self) -> list[Gauge]:
        """The gauges that are areas of walls."""
        return [gauge for gauge in self.gauge if gauge.kind is WALL_PRESSURE]

    @property
    def exchanges(self) -> bool:
        """Whether fluid may come in or leave."""
        return bool(self.domain.outflow or self.inlet or self.outlet)

    @property
    def conserved(self) -> tuple[str, ...]:
        """Scalars of the series that the scene keeps; the energy, but for what the scheme dissipates."""
        if self.exchanges:
            return ("mass_total",)
        own = any(fluid.acceleration for fluid in self.fluid)
        works = own or any(self.body_force) or any(wall.motion or wall.body for wall in self.wall)
        pulls = [any(forces) for forces in zip(self.gravity, self.body_force)]
        free = () if self.wall or own else (f"momentum_{axis}" for axis, pulled in zip(AXES, pulls) if not pulled)
        return ("mass", *(() if works else ("energy_total",)), *free)

    @property
    def dissipated(self) -> tuple[str, ...]:
        """Scalars that the scheme takes from by design: by viscosity, by fluxes and by shifts of particles."""
        n = self.numerics
        calm = n.viscosity_form == "none" and n.density_flux == "none" and not (n.artificial_viscosity or n.shifting)
        return () if calm else ("energy_total",)

    @classmethod
    def modernised(cls, tree: Tree) -> None:
        """One word for each viscosity and period, one kind of each shape; STL files are named relative to the file
        that names them, and known by what is in them.
        """
        listed = tree.data.get("fluid")
        fluids = [("fluid", i) for i in range(len(listed) if isinstance(listed, tuple) else 0)]
        one_viscosity(tree, fluids, "dynamic_viscosity", Fluid.model_fields["density"].default)
        one_period(tree, Period.model_fields)
        for group in ("fluid", "wall"):
            for path in matching(tree.data, (group, "shape")):
                one_of(tree, [(*path, kind) for kind in Shape.model_fields])
            attach(tree, (group, "shape", "stl"))
        for path in attach_arrays(tree, ("fluid", "start")):
            fluid, x = tree.data["fluid"][path[1]], attached_arrays(tree, path).get("position")
            dp = tree.data.get("numerics", {}).get("spacing")
            if "shape" not in fluid and x is not None and x.ndim == 2 and len(x) and isinstance(dp, int | float):
                low, high = (x.min(axis=0) - dp / 2).tolist(), (x.max(axis=0) + dp / 2).tolist()
                fluid["shape"] = {"box": {"low": low, "high": high}}


def name_of(kind: str, i: int, section: Fluid | Wall | Gauge | Opening) -> str:
    """The name of the i-th section of a kind, given or by default."""
    return section.name or f"{kind}_{i + 1}"


def shapes_of(config: SphConfig) -> list[Shape]:
    """The shapes of all fluids and walls."""
    return [fluid.shape for fluid in config.fluid] + [wall.shape for wall in config.wall]
