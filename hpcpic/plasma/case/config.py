"""What a plasma case says: the thesis's vocabulary (chapter 11) as a typed, frozen configuration.

Vectors are in physical order (x, y, z); 1D cases have x only. Older spellings of the thesis author's program
(grid.blocks x blocksize, simulation.method, sampling_period, scalars for vectors of one component) and words for
numbers (particle, temperature, particles_per_cell) are understood; setup.defaults replaces them by the present ones.
"""

import itertools
import math
from typing import Annotated, ClassVar, Literal

from numpy.typing import NDArray
from pydantic import BeforeValidator

from hpcpic.core.case.accelerations import MEANING
from hpcpic.core.case.config import Tree, dotted
from hpcpic.core.case.gauge import Gauge
from hpcpic.core.case.schema import (
    REQUIRED,
    Counts,
    Filled,
    Integers,
    Lengths,
    Section,
    Vector,
    as_tuple,
    matching,
    setting,
)
from hpcpic.core.case.words import last_side
from hpcpic.core.files.start import Start, arrays, attach_arrays, attached_arrays
from hpcpic.plasma.case import units
from hpcpic.plasma.case.not_there import Group
from hpcpic.plasma.case.older_words import drift_warnings, modernised

Names = Annotated[tuple[str, ...], BeforeValidator(as_tuple)]
BEFORE = "velocity_before"  # the array of `start` with velocities of half a step before
MOST_PARTICLES = 2**32  # of a species: their numbers have 32 bits
EITHER: dict[str, tuple[tuple[tuple[str, ...], ...], ...]] = {  # words of a group that say one thing
    "grid": ((("points",), ("blocks", "blocksize")),),
    "species": (
        (("particles",), ("particles_per_cell",)),
        (("particle",), ("charge", "mass")),
        (("density",), ("plasma_frequency",)),
        (("temperature",), ("thermal_velocity",)),
    ),
}
MOST_BLOCKS = 4096  # of a rank: tables of what each hands to each grow with their square
MOST_POINTS = 2**31 - 1  # of an axis: FFTW counts so far


class Simulation(Group):
    dimensions: Filled[Literal[1, 2, 3]] = setting(None, "1, 2 or 3; by default as many as space_length has")
    solver: Literal["MFT", "LU"] = setting("MFT", "field solver: multiple Fourier transform, or LU for small grids")
    cycles: int = setting(REQUIRED, "number of steps", "steps", ge=0)
    time_step: float = setting(REQUIRED, "time step, negative runs backwards", "s")
    space_length: Lengths = setting(
        REQUIRED, "size of the box, [Lx], [Lx, Ly] or [Lx, Ly, Lz]", "m", min_length=1, max_length=3
    )
    plasma_chunks: int = setting(0, "task blocks per rank, 0 = automatic", ge=0, le=MOST_BLOCKS)
    random_seed: int = setting(1, "seed of the random numbers", ge=0)
    stop_SEM: float = setting(
        0.0,
        "stop when the standard error of the mean step time, times 1.96, is below this fraction of the mean; 0 = never",
        ge=0,
    )


class Grid(Group):
    points: Filled[Counts] = setting(None, "grid points, [Nx], [Nx, Ny] or [Nx, Ny, Nz]", min_length=1, max_length=3)
    blocks: Counts | None = setting(None, "older spelling of points: blocks x blocksize", min_length=1, max_length=3)
    blocksize: Counts | None = setting(None, "older spelling of points: blocks x blocksize", min_length=1, max_length=3)


class Equation(Section):
    """The field equation a phi_xx + b phi_x + c phi + d phi_yy + e phi_y + f phi = -rho/eps0 (thesis (5.7)); in 3D with
    phi_zz on the left.

    As it stands it is Poisson's. c = -1/lambda^2 screens charges over lambda: electrons of a Debye length lambda that
    follow the potential at once, beside which only ions need to be particles.
    """

    a: float = setting(1.0, "factor of the second derivative along x")
    b: float = setting(0.0, "factor of the first derivative along x", "1/m")
    c: float = setting(0.0, "factor of phi, added to f", "1/m2")
    d: float = setting(1.0, "factor of the second derivative along y")
    e: float = setting(0.0, "factor of the first derivative along y", "1/m")
    f: float = setting(0.0, "factor of phi, added to c", "1/m2")


class FieldSection(Group):
    magnetic: Vector = setting((0.0, 0.0, 0.0), "uniform background magnetic field [Bx, By, Bz]", "T")
    electric: Vector = setting((0.0, 0.0, 0.0), "uniform external electric field [Ex, Ey, Ez]", "V/m")
    equation: Equation = Equation()


class Constants(Section):
    vacuum_permittivity: Filled[float] = setting(
        None, "permittivity of free space; by default 1, in SI units 8.854e-12", "F/m", gt=0
    )


class Perturbation(Group):
    mode: Integers = setting(
        REQUIRED, "whole wavelengths across the box, [nx], [nx, ny] or [nx, ny, nz]; k = 2 pi n / L"
    )
    amplitude: float = setting(0.0, "relative density a: positions move by (a/k) sin(k.x) along k", gt=-1, lt=1)
    velocity_amplitude: float = setting(0.0, "velocities change by b sin(k.x) along k", "m/s")


class Species(Group):
    name: str = setting("", "name in the output; by default species_1, species_2, ...")
    particles: Filled[int] = setting(None, "number of macro-particles", ge=0, le=MOST_PARTICLES)
    particles_per_cell: float | None = setting(None, "number of macro-particles per cell, in place of particles", gt=0)
    particle: Literal[*units.PARTICLES] | None = setting(  # type: ignore[valid-type]
        None, "a known particle, in place of charge and mass; needs density or plasma_frequency"
    )
    charge: Filled[float] = setting(
        None, "charge of a macro-particle; of one real particle where density or plasma_frequency is given", "C"
    )
    mass: Filled[float] = setting(None, "mass, of the same particle as charge", "kg", gt=0)
    density: float | None = setting(
        None,
        "real particles per volume, the mean of the box; a 1D box stands for 1 m2 of cross section, a 2D box for 1 m "
        "of depth",
        "1/m3",
        gt=0,
    )
    temperature: float | None = setting(
        None, "k_B T, in place of thermal_velocity = sqrt(k_B T/m); needs density or plasma_frequency", "eV", ge=0
    )
    drift_velocity: Vector = setting(
        (),
        'mean velocity; of "opposite beams" that of every second particle, the others have its opposite; of "uniform '
        'velocities" the bound v of velocities in [-v, v]',
        "m/s",
        max_length=3,
    )
    thermal_velocity: float = setting(0.0, "standard deviation of each velocity component", "m/s", ge=0)
    init_method: str = setting(
        "random",
        "random: random positions, drift plus thermal velocities; quiet: the same evenly; strata: as beams of equal "
        "weight, each evenly over the box; arrays: those of `start` (position, and velocity or velocity_before, that "
        "of half a step before, each as random where it is not there); default, random position: "
        "the thesis author's words for opposite beams and, without a thermal velocity, uniform velocities",
    )
    places: int | None = setting(
        None,
        '"strata": places of each velocity, of which there are particles / places; by default one in every second cell '
        "of each axis",
        ge=1,
    )
    position_init: Vector = setting((), '"position delta": position of the first particle', "m")
    position_delta: Vector = setting((), '"position delta": step from one particle to the next', "m")
    start: Start | None = None
    acceleration: str = setting("", MEANING, "m/s2")
    perturbation: Perturbation | None = None
    plasma_frequency: float = setting(
        0.0,
        "in place of density, at the mean of the box: sets charge and mass of a macro-particle by their ratio as "
        "given; 0 = not given",
        "rad/s",
        ge=0,
    )


HISTOGRAM_AXES = {"x": "m", "y": "m", "z": "m", "vx": "m/s", "vy": "m/s", "vz": "m/s"}  # with their units


class Histogram(Section):
    """The distribution of a species over a velocity, a position, or two of them, whose integral is the number of real
    particles in the bins. Positions and velocities are of the same time.
    """

    name: str = setting("", "name in histograms.h5; by default histogram_1, histogram_2, ...")
    species: str = setting("", "species to count; by default the only one")
    of: Names = setting(REQUIRED, 'one axis or two: x, y, z, vx, vy, vz; ["x", "vx"] is phase space')
    bins: Counts = setting((), "bins along each axis; by default 200 of a velocity, the cells of a position")
    low: Vector = setting(
        (), "lower ends; by default of the box, of velocities 6 thermal velocities beyond the drifts", "m, m/s"
    )
    high: Vector = setting((), "upper ends", "m, m/s")


class Every(Section):
    series: int | None = setting(
        None,
        "steps between samples of the series, 0 = never; by default what costs a long run 5 % (the thesis: "
        "simulation.sampling_period.energy)",
        "steps",
        ge=0,
    )
    fields: int | None = setting(
        None, "steps between snapshots of the fields, 0 = never (output.sampling_period.field)", "steps", ge=0
    )
    particles: int | None = setting(
        None, "steps between snapshots of the particles, 0 = never (output.sampling_period.particle)", "steps", ge=0
    )
    histograms: int | None = setting(
        None,
        "steps between counts of the histograms, 0 = never; by default a hundredth of the run, more where that would "
        "take more than 5 % of it and more than a second",
        "steps",
        ge=0,
    )
    checkpoint: int | None = setting(
        None, "steps between checkpoints, 0 = only at the end and at an early stop", "steps", ge=0
    )


class Period(Section):
    series: float | None = setting(None, "time between samples of the series, instead of every.series", "s", ge=0)
    fields: float | None = setting(None, "time between snapshots of the fields", "s", ge=0)
    particles: float | None = setting(None, "time between snapshots of the particles", "s", ge=0)
    histograms: float | None = setting(None, "time between counts of the histograms", "s", ge=0)
    checkpoint: float | None = setting(None, "time between checkpoints", "s", ge=0)


class Output(Section):
    path: str | None = setting(None, "run folder, when the command line names none")
    fields: Names = setting(
        ("rho", "phi", "E"),
        "fields in snapshots: rho, phi, E, and of each species n (density), u (mean velocity), T (temperature in J of "
        "the velocity components that the scene has)",
    )
    modes: Annotated[tuple[Integers, ...], BeforeValidator(as_tuple)] = setting(
        (),
        "modes of E along k as columns of the series: whole wavelengths across the box, ([nx], ..), ([nx, ny], ..) or "
        "([nx, ny, nz], ..); "
        "mode_nx_re, mode_nx_im are the parts of E_k where E = Re(E_k exp(i k.x))",
    )
    every: Every = Every()
    period: Period = Period()
    openpmd: bool = setting(False, "write snapshots as openPMD too")


class Numerics(Group):
    shape: Literal["NGP", "CIC", "TSC"] = setting("CIC", "particle shape: order 0, 1 (the thesis) or 2")
    gradient: Literal["difference", "spectral"] = setting("difference", "E = -grad phi by (5.13), or by ik and k^2")
    cloud_radius: float = setting(
        0.0,
        "standard deviation of a Gaussian by which the solver spreads charges, and the field that they feel, beyond "
        "their shape; less heating, and waves of a cold plasma slower by exp(-(k R)^2/2)",
        "m",
        ge=0,
    )
    precision: Literal["double", "single"] = setting("double", "arithmetic of the particles")
    exact_phase: bool = setting(False, "Boris rotation with t = tan(wc dt/2), likewise impulses across B")
    reproducible: Literal[True] = setting(True, "same bits for any ranks, threads and task blocks")


class PlasmaConfig(Group):
    """A whole plasma case."""

    ignored: ClassVar[tuple[str, ...]] = (
        "plot",
        "constants.light_speed",
        "constants.boltzmann_constant",
        "simulation.enable_fftw_threads",
        "simulation.mft_tap_workers",
        "simulation.pblock_nmax",
        "simulation.realtime_plot",
        "simulation.fftw_recompute_plan",
        "output.slices",
        "output.alignment",
        "species.cyclotron_frequency",
        "species.charge_mass_ratio",
    )

    description: str = setting("", "one sentence")
    units: Literal["normalised", "SI"] = setting(
        "normalised",
        "SI: s, m, kg, C, V, eV as they stand here; normalised: the case's own units in their places, in which "
        "vacuum permittivity, elementary charge and electron mass are 1",
    )
    simulation: Simulation
    grid: Grid
    field: FieldSection = FieldSection()
    constants: Constants = Constants()
    species: tuple[Species, ...] = ()
    numerics: Numerics = Numerics()
    gauge: tuple[Gauge, ...] = ()
    histogram: tuple[Histogram, ...] = ()
    output: Output = Output()

    @property
    def dimensions(self) -> int:
        return self.simulation.dimensions or len(self.simulation.space_length)

    @property
    def points(self) -> tuple[int, ...]:
        """Points of the grid, in either spelling."""
        grid = self.grid
        return grid.points or tuple(n * m for n, m in zip(grid.blocks or (), grid.blocksize or ()))

    @property
    def cells(self) -> int:
        return math.prod(self.points)

    @property
    def n_steps(self) -> int:
        return self.simulation.cycles

    @property
    def end_time(self) -> float:
        """Time of the last step, s."""
        return self.n_steps * self.simulation.time_step

    @property
    def periods(self) -> dict[str, int]:
        """Steps between samples of series, field, particle, histogram, openPMD files, checkpoints; 0 = never."""
        every = self.output.every
        snapshots = [steps for steps in (every.fields, every.particles) if steps]
        return {
            "series": every.series or 0,
            "field": every.fields or 0,
            "particle": every.particles or 0,
            "histogram": (every.histograms or 0) if self.histogram else 0,
            "openpmd": min(snapshots, default=0) if self.output.openpmd else 0,
            "checkpoint": every.checkpoint or 0,
        }

    @classmethod
    def modernised(cls, tree: Tree) -> None:
        modernised(tree)
        for path in attach_arrays(tree, ("species", "start")):
            species = tree.data["species"][path[1]]
            species.setdefault("init_method", "arrays")
            if "particles_per_cell" not in species:
                lengths = [len(values) for values in attached_arrays(tree, path).values() if values.ndim]
                species.setdefault("particles", max(lengths, default=0))
        for group, pairs in EITHER.items():
            for path, sides in itertools.product(matching(tree.data, (group,)), pairs):
                last_side(tree, path, sides)
        for path in matching(tree.data, ("species",)):
            species = tree.data["species"][path[-1]] if len(path) == 2 else tree.data["species"]
            tree.warnings += [f"{dotted(path)}.{text}" for text in drift_warnings(species)]

    @property
    def conserved(self) -> tuple[str, ...]:
        """Scalars of the series that the scene keeps: a magnetic field turns momentum, an electric one does work."""
        magnetic, electric = self.field.magnetic, self.field.electric
        if any(species.acceleration for species in self.species):
            return ("charge",)
        if self.field.equation.b or self.field.equation.e:  # what one charge does to another does not come back
            return ("charge",)
        along = (k for k in range(3) if not electric[k] and not any(b for i, b in enumerate(magnetic) if i != k))
        return ("charge", *(() if any(electric) else ("energy_total",)), *(f"momentum_{'xyz'[k]}" for k in along))


def name_of(species: Species, i: int) -> str:
    """The name of species[i], given or by default."""
    return species.name or f"species_{i + 1}"


def mode_columns(mode: tuple[int, ...]) -> tuple[str, str]:
    """Columns of the series with the real and the imaginary part of a mode."""
    name = f"mode_{'_'.join(map(str, mode))}"
    return f"{name}_re", f"{name}_im"


def given_velocity(species: Species) -> NDArray | None:
    """The velocities that a species starts with as an array, at the start or half a step before; None where there are
    none.
    """
    given = arrays(species.start) if species.start else {}
    return given.get("velocity", given.get(BEFORE))


def starts_before(species: Species) -> bool:
    """True if the velocities that a species starts with are those of half a step before, where the mover has them."""
    return species.start is not None and BEFORE in arrays(species.start)


def velocity_columns(species: Species) -> int:
    """Components of the velocities that a species starts with as an array; 0 where there is none."""
    velocity = given_velocity(species)
    return velocity.shape[1] if velocity is not None and velocity.ndim == 2 else 0


def velocity_components(config: PlasmaConfig) -> int:
    """Velocity components that the motion needs: 1 or 3 in 1D, 2 or 3 in 2D, 3 in 3D.

    All three are there when the magnetic field turns velocities out of the plane (any B in 1D, an in-plane
    B in 2D), or when something pushes or drifts along an axis that has no grid.
    """
    d = config.dimensions
    bends = any(config.field.magnetic) if d == 1 else any(config.field.magnetic[:2])
    pushed = any(config.field.electric[d:]) or any(
        any(s.drift_velocity[d:]) or velocity_columns(s) > d for s in config.species
    )
    return 3 if bends or pushed else d


def rotation(config: PlasmaConfig) -> int:
    """Kind of rotation of velocities in the magnetic field (5.4.1): 0 there is none, 1 about z, 2 about any other axis,
    3 about any other with an exact angle, for which the impulse across it is another one than along it.
    """
    bx, by, bz = config.field.magnetic
    return (3 if config.numerics.exact_phase else 2) if bx or by else int(bz != 0)


def volume(config: PlasmaConfig) -> float:
    """Length (1D, m), area (2D, m2) or volume (m3) of the box."""
    return math.prod(config.simulation.space_length)
