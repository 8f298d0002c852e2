"""What pair sums are made for, and the passes over all pairs that a case needs: lines of formulas, and their sums."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from sph.physics import terms
from sph.physics.fluxes import FLUXES, Flux
from sph.physics.viscosities import VISCOSITIES, Viscosity

AXES = "xyz"
UNIT = 2.0**-24  # of fixed-point positions, in h
NUMBERS = (
    "artificial", "viscous", "flux_strength", "gravityx", "gravityy", "gravityz", "reach", "per_w", "per_h", "eta2",
    "core", "core_reach", "density", "hundredth", "fallx", "fally", "fallz", "half_step",
)  # fmt: skip
VECTORS = ("v", "n", "g", "gravity", "fall", "force", "steps", "shifts", "arm", "own", "moment1", "slope0")
TRIANGLES = ("l", "t", "moments", "matrix", "slope1")  # symmetric matrices
MATRICES = ("strains", "s")


@dataclass(frozen=True)
class PairSpec:
    """What the pair sums of a scene are made for."""

    dimensions: int
    kernel: str
    flux: Flux = FLUXES["none"]
    viscosity: Viscosity = VISCOSITIES["none"]
    artificial: bool = False
    single: bool = False
    walls: bool = False
    """Whether bodies of other classes than fluid are there."""
    without_volume: bool = False
    """Whether none of these has a volume or is seen in a mirror: density flows among fluid only."""
    repulsive: bool = False
    extrapolated: bool = False
    """Whether there are walls whose density follows from the fluid before them."""
    accelerated: bool = False
    """Whether some of these are accelerated."""
    turning: bool = False
    """Whether some of these turn."""
    driven: bool = False
    """Whether fluids have accelerations of the user's own."""
    films: bool = False
    """Whether some press on each other across a film of fluid."""
    edges: bool = False
    """Whether such walls have edges."""
    wetted: bool = False
    """Whether friction lacks a torque on those that turn, where they are wet (see particles.wall_forces)."""
    sticking: bool = False
    """Whether fluid sticks to some that turn, by friction along velocities."""
    tensile: bool = False
    shifting: bool = False
    corrected: bool = False
    by_mass: bool = False
    """Whether rates of density follow from masses (SC 3), not from volumes (MP 16)."""
    moments: bool = False
    """Whether snapshots hold the moments of the kernel."""
    densities: bool = False
    """Whether liquids differ in density."""
    viscosities: bool = False
    """Whether they differ in viscosity."""
    gases: bool = False
    """Whether there are gases beside liquids."""
    split: bool = False
    """Whether forces and rates are summed one after the other."""

    @property
    def in_turn(self) -> bool:
        """Whether a column can hold 1 / rho for forces, then volumes for rates."""
        later = self.needs_gradient or self.shifting or self.corrected or self.needs_stress or self.gases
        return self.split and not later

    @property
    def changes(self) -> bool:
        """Whether columns change between forces and rates, besides the state."""
        return self.single or self.needs_gradient or self.in_turn

    @property
    def real(self) -> str:
        return "float32" if self.single else "float64"

    @property
    def axes(self) -> str:
        return AXES[: self.dimensions]

    @property
    def needs_gradient(self) -> bool:
        return "g" in self.flux.columns

    @property
    def needs_stress(self) -> bool:
        return self.viscosity.sees_strain

    def components(self, name: str) -> list[str]:
        """The columns, sums or numbers that a name stands for: those of a vector, of a matrix, or itself."""
        if name in VECTORS:
            return [name + a for a in self.axes]
        if name == "turn":
            return ["turnz"] if self.dimensions == 2 else ["turnx", "turny", "turnz"]
        if name in TRIANGLES:
            return [name + a + b for k, a in enumerate(self.axes) for b in self.axes[k:]]
        if name in MATRICES:
            return [name + a + b for a in self.axes for b in self.axes]
        return [name]


class Pairs(NamedTuple):
    """Pairs on which a term acts: those whose flags `mask` chooses (see kernels.passes), in a case that has others too.

    No mask: all. among_fluid: two particles of fluid are such a pair; else the loop for these alone is without the
    term. elsewhere: what the term is for all other pairs; "": no change.
    """

    mask: str
    among_fluid: bool = True
    elsewhere: str = ""


ALL = Pairs("")
OF_FLUID = Pairs("both_flow", elsewhere="zero")
WITHOUT_SLIP = Pairs("none_slips", elsewhere="zero")
BESIDE_SOLIDS = Pairs("", among_fluid=False)  # of a term that is 0 for others by itself
AT_FOLLOWING_WALLS = Pairs("one_follows", among_fluid=False)  # walls whose density follows from the fluid
AT_EDGES = Pairs("at_edges", among_fluid=False)  # of walls whose density follows from the fluid
AT_STICKING_WALLS = Pairs("one_sticks", among_fluid=False)  # these without slip


class Line(NamedTuple):
    """`out`, names separated by commas, becomes what the formula gives, for these pairs."""

    out: str
    formula: Callable
    pairs: Pairs = ALL


class Sum(NamedTuple):
    """One sum over pairs: of i, weight[0] times term[0]; of j, weight[1] times term[1]; component by component."""

    name: str
    weights: tuple[str, str]
    terms: tuple[str, str]


@dataclass
class Pass:
    """Lines of a pair, sums of them, and lines that give `wall`, the further force on i next to a repulsive wall.

    inside: fluid that meets nothing else takes part. by_volume: a body gives in proportion to its volume. films: of
    rigid bodies, measured solids and what is beside them takes part what lies on either side of a film of fluid, too
    thin to bear all that they press on each other. midway: pairs are as far apart as half a step later, of those that
    are near each other now.
    """

    lines: list[Line] = field(default_factory=list)
    sums: list[Sum] = field(default_factory=list)
    wall: list[Line] = field(default_factory=list)
    inside: bool = True
    by_volume: bool = False
    films: bool = False
    midway: bool = False


def momentum(spec: PairSpec) -> Pass:
    """Forces of pressure and viscosity on i and j, which are opposite."""
    viscosity = spec.viscosity
    lines = [Line("push", terms.pressure), Line("push", terms.kept_out, AT_FOLLOWING_WALLS)]
    lines += [Line("push", terms.let_go, AT_EDGES)] * spec.edges
    if spec.artificial:
        damping = terms.damping_between if spec.densities else terms.damping
        lines += [Line("damping", damping, WITHOUT_SLIP), Line("push", terms.artificial_viscosity)]
    if "friction" in terms.needs(viscosity.push or viscosity.pull):
        lines.append(Line("friction", terms.friction_between if spec.viscosities else terms.friction, WITHOUT_SLIP))
        lines += [Line("friction", terms.wall_friction, AT_STICKING_WALLS)] * (not spec.viscosities)
    if viscosity.push:
        lines.append(Line("push", viscosity.push))
    lines += [Line("push", terms.tensile_correction)] * spec.tensile
    if spec.corrected or viscosity.pull:
        lines.append(Line("pull", terms.corrected_pull if spec.corrected else terms.pull))
        if viscosity.pull:
            lines.append(Line("pull", viscosity.pull))
        lines += [Line("pull", terms.at_the_surface, BESIDE_SOLIDS)] * spec.sticking
        if viscosity.transposed:
            lines.append(Line("crosswise", terms.crosswise_between if spec.viscosities else terms.crosswise))
            lines += [Line("crosswise", terms.crosswise_at_wall, AT_FOLLOWING_WALLS)] * (not spec.viscosities)
            lines.append(Line("pull", viscosity.transposed))
        lines.append(Line("minus_g, g", terms.tensor_force))
        force = Sum("force", ("minus_g", "g"), ("pull", "pull"))
    else:
        lines.append(Line("minus_g, g", terms.central_force))
        force = Sum("force", ("minus_g", "g"), ("d", "d"))
    wall = [Line("wall", terms.repulsion)] * spec.repulsive
    if wall and viscosity.wall_drag:
        wall.append(Line("wall", viscosity.wall_drag))
    return Pass(lines, [force], wall, films=spec.films)


def continuity(spec: PairSpec) -> Pass:
    """Rates of density, with the flux of the case."""
    flux = spec.flux
    lines = [Line("vd_i, vd_j", terms.corrected_approach if spec.corrected else terms.approach)]
    lines.append(Line("to_i, to_j", terms.volumes))
    if flux.correction:
        lines.append(Line("d_rho", flux.correction))
    if flux.formula:
        lines.append(Line("flux", flux.formula, OF_FLUID))
        lines += [Line("flux", terms.flux_within)] * spec.densities
    rates: Callable
    if spec.gases:
        rates = terms.bulk_continuity_with_flux if flux.formula else terms.bulk_continuity
    elif spec.by_mass:
        rates = terms.continuity_by_mass_with_flux if flux.formula else terms.continuity_by_mass
    else:
        rates = terms.continuity_with_flux if flux.formula else terms.continuity
    sums = [Sum("rate", ("to_i", "to_j"), ("rate_i", "rate_j"))]
    return Pass([*lines, Line("rate_i, rate_j", rates)], sums, by_volume=True, midway=spec.split)


def gradient(spec: PairSpec) -> Pass:
    """Sums for the renormalised density gradient of the fluid, of each liquid by itself."""
    lines = [Line("fluid_F", terms.fluid_F, OF_FLUID)] + [Line("fluid_F", terms.within)] * spec.densities
    lines += [Line("less_i, less_j", terms.minus_fluid_volumes), Line("by_i, by_j", terms.fluid_volumes)]
    lines += [Line("moments", terms.moments), Line("steps", terms.steps)]
    sums = [Sum("moments", ("less_i", "less_j"), ("moments",) * 2), Sum("steps", ("by_i", "by_j"), ("steps",) * 2)]
    return Pass(lines, sums)


def extrapolation(spec: PairSpec) -> Pass:
    """Sums at particles of walls over the fluid before them: weights, density, and the way from the fluid."""
    there = terms.at_the_other_of if spec.densities else terms.at_the_other
    lines = [Line("rise", terms.rise_with_own)] * spec.driven
    lines += [Line("heavy_i, heavy_j", terms.wall_weights), Line("from_i, from_j", there)]
    by = ("heavy_i", "heavy_j")
    sums = [Sum("weight", by, ("one", "one")), Sum("there", by, ("from_i", "from_j"))]
    if spec.accelerated and spec.densities:
        lines.append(Line("arm_i, arm_j", terms.arms_of))
    if spec.accelerated:
        sums.append(Sum("arm", ("arm_i", "arm_j") if spec.densities else by, ("d", "back")))
    if spec.wetted and spec.viscosities:
        lines.append(Line("thick_i, thick_j", terms.thick))
        sums.append(Sum("thick", ("thick_i", "thick_j"), ("one", "one")))
    return Pass(lines, sums, inside=False)


def strain(spec: PairSpec) -> Pass:
    """Sums of the velocity gradient; renormalised and of the fluid alone where free surfaces ask for it."""
    less, lines = ("less_i", "less_j"), [Line("strains", terms.strains)]
    if not spec.viscosity.transposed:
        return Pass([Line("less_i, less_j", terms.minus_volumes), *lines], [Sum("strains", less, ("strains",) * 2)])
    lines += [Line("fluid_F", terms.fluid_F, OF_FLUID), Line("less_i, less_j", terms.minus_fluid_volumes)]
    lines.append(Line("moments", terms.moments))
    return Pass(lines, [Sum("strains", less, ("strains",) * 2), Sum("moments", less, ("moments",) * 2)])


def matrix(_: PairSpec) -> Pass:
    """Sums of the matrix that renormalises all gradients."""
    lines = [Line("less_i, less_j", terms.minus_volumes), Line("matrix", terms.moments)]
    return Pass(lines, [Sum("matrix", ("less_i", "less_j"), ("matrix",) * 2)])


def kernel_moments(_: PairSpec) -> Pass:
    """Sums of (MP 12), but for a particle's own W, and of (MP 13), whose W' is that by x_j: - F r_ij."""
    lines = [Line("weight_i, weight_j", terms.weights), Line("less_i, less_j", terms.minus_volumes)]
    lines.append(Line("to_i, to_j", terms.volumes))
    lines.append(Line("moments", terms.moments))
    both = ("weight_i", "weight_j")
    sums = [Sum("moment0", both, ("one", "one")), Sum("moment1", both, ("d", "back"))]
    sums += [Sum("slope0", ("less_i", "to_j"), ("d", "d")), Sum("slope1", ("less_i", "less_j"), ("moments",) * 2)]
    return Pass(lines, sums)


def shifting(_: PairSpec) -> Pass:
    """Sums of shifts, and of - V F r^2: d where fluid is all around."""
    lines = [Line("apart_i, apart_j", terms.shifts), Line("around_i, around_j", terms.minus_volumes)]
    sums = [Sum("shifts", ("apart_i", "apart_j"), ("d", "d")), Sum("around", ("around_i", "around_j"), ("r2", "r2"))]
    return Pass(lines, sums)


def passes_of(spec: PairSpec) -> dict[str, Pass]:
    """The passes over all pairs of a case, by title."""
    stages = [gradient] if spec.needs_gradient else []
    spread = [shifting] if spec.shifting else []
    titles: dict[str, list[Callable[[PairSpec], Pass]]] = {}
    if spec.split:  # before and after the velocity changes
        titles |= {"first": [momentum, *stages, *spread], "second": [continuity]}
    else:
        titles |= {"both": [momentum, continuity, *spread]} | ({"slopes": stages} if stages else {})
    if spec.extrapolated:
        titles["walls"] = [extrapolation]
    if spec.corrected:
        titles["matrices"] = [matrix]
    if spec.needs_stress:
        titles["strain"] = [strain]
    if spec.moments:
        titles["moments"] = [kernel_moments]
    return {title: joined([part(spec) for part in parts]) for title, parts in titles.items()}


def joined(parts: list[Pass]) -> Pass:
    """One pass of several."""
    every = [(part.lines, part.sums, part.wall) for part in parts]
    lines, sums, wall = ([item for group in groups for item in group] for groups in zip(*every))
    inside, by_volume = any(part.inside for part in parts), all(part.by_volume for part in parts)
    films, midway = any(part.films for part in parts), all(part.midway for part in parts)
    return Pass(lines, sums, wall, inside, by_volume, films, midway)


def sums_of(spec: PairSpec, one: Pass) -> list[str]:
    """What a pass leaves in sums[k]."""
    return [name for entry in one.sums for name in spec.components(entry.name)]


def most_sums(spec: PairSpec) -> int:
    """Accumulators of the pass that has most."""
    return max(len(sums_of(spec, one)) for one in passes_of(spec).values())


def columns_of(spec: PairSpec) -> list[str]:
    """Columns of a slot besides what the state has: what `pack` and other pair sums fill in."""
    names = ["push", "light"] + ["volume"] * (not spec.in_turn)
    if spec.single:
        names += ["excess", "mass", "v"]
    elif spec.densities:
        names.append("mass")  # of the reference liquid
    names += ["swift"] * spec.densities + ["fluidity"] * spec.viscosities + ["bulk"] * spec.gases
    names += ["n"] * spec.repulsive + [name for name in ("g", "slope", "c") if name in spec.flux.columns]
    names += ["own"] * (spec.driven and spec.extrapolated) + ["turn"] * spec.sticking
    names += ["tension"] * spec.tensile + ["l"] * spec.corrected
    names += ["t"] * spec.viscosity.stress + ["s"] * bool(spec.viscosity.transposed)
    return [column for name in names for column in spec.components(name)]


def state_of(spec: PairSpec) -> dict[str, str]:
    """Columns that are the state, and where it is held."""
    mass = {} if spec.densities else {"mass": "m"}
    return {"excess": "drho"} | mass | {f"v{a}": f"v[{k}]" for k, a in enumerate(spec.axes)}


def unused(spec: PairSpec, staged: bool) -> set[str]:
    """Columns of the bodies that a case has no need of."""
    needed = {
        "gradient": spec.needs_gradient, "shear": spec.needs_stress,
        "matrix": spec.corrected, "offset": spec.shifting, "wetted": spec.wetted, "own": spec.driven,
        "x_old": staged, "v_old": staged or spec.shifting, "drho_old": staged,
    }  # fmt: skip
    return {name for name, used in needed.items() if not used}
