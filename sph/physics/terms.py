"""Pair sums of a scene as generated text: each pair of bodies once, for both, along the runs of `runs.find`.

Lengths, velocities, densities and masses are in units that the numbers of a scene know: in double precision the state
is read as it is held, in SI units; in single, columns in those of c0, rho0 and rho0 h^d, positions in UNIT. F lacks a
factor (see `functions`), which the scales of a scene make up for in the sums. A pass is a set of terms (momentum,
continuity, ...) that share the distance and the kernel. Layers of even number come first, then the odd ones; each adds
to what it and the next one have, so that those of a kind are independent and the result does not depend on who computes
them. Lanes count from the start of a run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from sph.physics.smoothing import SMOOTHING

UNIT = 2.0**-24  # of fixed-point positions, in h
AXES = "xyz"


@dataclass(frozen=True)
class Law:
    """What pair sums are made for."""

    dimensions: int
    kernel: str
    flux: str = "none"
    viscosity: str = "none"
    artificial: bool = False
    single: bool = False
    walls: bool = False
    """Whether bodies of other classes than fluid are there."""
    repulsive: bool = False
    tensile: bool = False
    shifting: bool = False
    corrected: bool = False
    split: bool = False
    """Whether forces and rates are summed one after the other."""

    @property
    def in_turn(self) -> bool:
        """Whether a column can hold 1 / rho for forces, then volumes for rates."""
        return self.split and not (self.needs_gradient or self.shifting or self.corrected or "strain" in self.viscosity)

    @property
    def real(self) -> str:
        return "float32" if self.single else "float64"

    @property
    def axes(self) -> str:
        return AXES[: self.dimensions]

    @property
    def needs_gradient(self) -> bool:
        return self.flux == "delta"


@dataclass
class Terms:
    """Lines of a pair and what they add: (sum, coefficient for i, for j, factor for i, for j)."""

    columns: set[str] = field(default_factory=set)
    lines: list[str] = field(default_factory=list)
    """Those with `mixing` are for pairs that may not be both of fluid."""
    sums: list[tuple[str, str, str, str, str]] = field(default_factory=list)
    rare: list[str] = field(default_factory=list)
    """Lines for vectors with a repulsive particle, that leave the further force on i in ex, ey, ez."""

    def need(self, *columns: str) -> None:
        self.columns.update(columns)


def columns_of(law: Law) -> list[str]:
    """Columns of a slot besides what the state has: what `pack` and other pair sums fill in."""
    names = ["push", "light"] + ([] if law.in_turn else ["volume"])
    if law.single:
        names += state_of(law)
    if law.repulsive:
        names += [f"n{a}" for a in law.axes]
    if law.flux == "delta":
        names += [f"g{a}" for a in law.axes]
    if law.flux == "fourtakas":
        names += ["slope"]
    if law.tensile:
        names += ["tension"]
    if law.corrected:
        names += [f"l{a}{b}" for k, a in enumerate(law.axes) for b in law.axes[k:]]
    if law.viscosity == "strain-rate":
        names += [f"t{a}{b}" for k, a in enumerate(law.axes) for b in law.axes[k:]]
    return names


def state_of(law: Law) -> dict[str, str]:
    """Columns that are the state, and where it is held."""
    return {"excess": "drho", "mass": "m"} | {f"v{a}": f"v[{k}]" for k, a in enumerate(law.axes)}


def _relative_velocity(law: Law, terms: Terms) -> None:
    if any(line.startswith("    vd =") for line in terms.lines):
        return
    terms.need(*(f"v{a}" for a in law.axes))
    terms.lines += [f"    d{a}v = v{a}_i - v{a}_j" for a in law.axes]
    vd = f"d{law.axes[-1]}v * d{law.axes[-1]}"
    for a in law.axes[-2::-1]:
        vd = f"fma(d{a}v, d{a}, {vd})"
    terms.lines.append(f"    vd = {vd}")


def momentum(law: Law, terms: Terms) -> None:
    """(MP 20), (SC 5): force on i = - m_i m_j (p_i / rho_i^2 + p_j / rho_j^2 + Pi) F r_ij; exactly opposite on j."""
    terms.need("push", "mass")
    terms.lines.append("    push = push_i + push_j")
    if law.artificial or law.viscosity in ("cleary", "morris"):
        _relative_velocity(law, terms)
        terms.need("light")
    if law.artificial or law.viscosity == "cleary":
        terms.lines.append("    near = vd / (r2 + eta2)")
    if law.artificial:  # Monaghan's, with the mean of 1 / rho
        terms.lines.append("    push = fma(minimum(near, 0.0), fma(light_j, artificial, light_i * artificial), push)")
    if law.viscosity == "cleary":  # (SC 6), equal viscosities
        terms.lines.append("    push = fma(near * light_j, light_i * viscous, push)")
    if law.tensile:  # Monaghan 2000, with the fourth power of W over W at the spacing
        terms.need("tension")
        _crowding(law, terms)
        terms.lines.append("    push = fma(tension_i + tension_j, crowding, push)")
    if law.repulsive:
        terms.rare = repulsion(law)
    if law.corrected:
        _corrected_force(law, terms)
        return
    if law.viscosity == "strain-rate":
        _stress_force(law, terms)
        return
    if law.viscosity == "morris":
        _drag_force(law, terms)
        return
    terms.lines += ["    g = (push * F) * (mass_i * mass_j)", "    minus = -g"]
    terms.sums += [(f"f{a}", "minus", "g", f"d{a}", f"d{a}") for a in law.axes]


def _crowding(law: Law, terms: Terms) -> None:
    if not any(line.startswith("    crowding =") for line in terms.lines):
        terms.lines += [
            f"    ratio = ({SMOOTHING[law.kernel].shape_line}) * per_w",
            "    ratio = ratio * ratio",
            "    crowding = ratio * ratio",
        ]


def _corrected(law: Law, terms: Terms, side: str) -> list[str]:
    """Components of L r_ij with the renormalisation of one side."""
    components = []
    for a in law.axes:
        names = ["l" + "".join(sorted(a + b)) for b in law.axes]
        terms.need(*names)
        text = f"{names[-1]}_{side} * d{law.axes[-1]}"
        for name, b in zip(names[-2::-1], law.axes[-2::-1]):
            text = f"fma({name}_{side}, d{b}, {text})"
        components.append(text)
    return components


def _corrected_force(law: Law, terms: Terms) -> None:
    """Force on i = - m_i m_j F (push_i L_i + push_j L_j + rest) r_ij, rest what is not pressure; opposite on j."""
    terms.lines += ["    g = F * (mass_i * mass_j)", "    minus = -g", "    rest = push - (push_i + push_j)"]
    for a, by_i, by_j in zip(law.axes, _corrected(law, terms, "i"), _corrected(law, terms, "j")):
        terms.lines.append(f"    s{a} = fma(push_i, {by_i}, fma(push_j, {by_j}, rest * d{a}))")
        if law.viscosity == "morris":
            terms.lines.append(f"    s{a} = fma(light_i * light_j * viscous, d{a}v, s{a})")
        if law.viscosity == "strain-rate":
            for b in law.axes:
                name = "t" + "".join(sorted(a + b))
                terms.need(name)
                terms.lines.append(f"    s{a} = fma(-({name}_i + {name}_j), d{b}, s{a})")
        terms.sums.append((f"f{a}", "minus", "g", f"s{a}", f"s{a}"))


def repulsion(law: Law) -> list[str]:
    """(SC 8)-(10), b = 1, s = 8: force 0.01 c^2 m / h B S along the normal of the wall particle. Nearer than 0.4 h,
    where nothing comes from before the wall (that takes 0.5 c), S falls to 0 at the wall particle. And (SC 6) with the
    mass of the wall particle. `reach` = h / dp.
    """
    lines = [f"n{a} = load(F_, n{a}_, j) - n{a}_[i]" for a in law.axes]
    y = f"d{law.axes[-1]} * n{law.axes[-1]}"
    for a in law.axes[-2::-1]:
        y = f"fma(d{a}, n{a}, {y})"
    lines += [f"y = ({y}) * per_h"]
    hats = [f"maximum(1.0 - abs(fma(-y, n{a}, d{a} * per_h)) * reach, 0.0)" for a in law.axes]
    lines += [
        "steep = 0.8 / maximum(y, 0.4)",
        "steep = steep * steep",
        "steep = steep * steep",
        "weak = 25.0 * ((1.0 - y) * (1.0 - y))",
        "strength = select(y < 0.8, steep * steep, select(y < 1.0, weak, 0.0))",
        f"strength = strength * ({' * '.join(hats)})",
        "strength = maximum(minimum(y * 2.5, 1.0), 0.0) * strength * (hundredth * (mass_i + mass_j))",
        "strength = select(lane < np.int32(end - j), strength, 0.0)",
    ]
    lines += [f"e{a} = strength * n{a}" for a in law.axes]
    if law.viscosity == "cleary":
        lines.append("masses = mass_i * solid_j + solid_i * mass_j")
        lines.append("drag = (near * (light_i * light_j)) * (viscous * F) * masses")
        lines += [f"e{a} = e{a} - drag * d{a}" for a in law.axes]
    if law.viscosity == "morris":
        lines.append("masses = mass_i * solid_j + solid_i * mass_j")
        lines += [f"e{a} = e{a} - (light_i * light_j) * (viscous * F) * masses * d{a}v" for a in law.axes]
    return lines


def _stress_force(law: Law, terms: Terms) -> None:
    """(MP 23): force on i = m_i m_j F (T r - push r), T = mu (eps_i / rho_i^2 + eps_j / rho_j^2)."""
    terms.lines.append("    g = F * (mass_i * mass_j)")
    terms.lines.append("    minus = -g")
    for a in law.axes:
        terms.lines.append(f"    s{a} = -(push * d{a})")
        for b in law.axes:
            name = "t" + "".join(sorted(a + b))
            terms.need(name)
            terms.lines.append(f"    s{a} = fma({name}_i + {name}_j, d{b}, s{a})")
        terms.sums.append((f"f{a}", "g", "minus", f"s{a}", f"s{a}"))


def _drag_force(law: Law, terms: Terms) -> None:
    """Morris et al. 1997: force on i = m_i m_j F (2 mu v_ij / (rho_i rho_j) - push r_ij), opposite on j. No r^2 is
    divided by, so it needs no small number beside it.
    """
    terms.lines += ["    g = F * (mass_i * mass_j)", "    minus = -g", "    drag = (light_i * light_j) * viscous"]
    for a in law.axes:
        terms.lines.append(f"    s{a} = fma(drag, d{a}v, push * d{a})")
        terms.sums.append((f"f{a}", "minus", "g", f"s{a}", f"s{a}"))


def continuity(law: Law, terms: Terms) -> None:
    """(MP 16) with a flux of density: (MP 17), Molteni and Colagrossi, Fourtakas, Antuono (delta)."""
    _relative_velocity(law, terms)
    terms.need("excess", "volume")
    terms.lines += ["    rho_i, rho_j = excess_i + density, excess_j + density"]
    terms.lines += ["    to_i = volume_j * F", "    to_j = volume_i * F"]
    terms.lines += ["    vd_i, vd_j = vd, vd"]
    if law.corrected:
        for side in "ij":
            products = [f"d{a}v * ({text})" for a, text in zip(law.axes, _corrected(law, terms, side))]
            terms.lines.append(f"    vd_{side} = " + " + ".join(products))
    if law.flux == "none":
        terms.lines += ["    rate_i, rate_j = rho_i * vd_i, rho_j * vd_j"]
    else:
        terms.lines += ["    d_rho = excess_j - excess_i", *_flux_lines(law, terms)]
        terms.lines += ["    rate_i, rate_j = fma(rho_i, vd_i, -flux), fma(rho_j, vd_j, flux)"]
    terms.sums.append(("rate", "to_i", "to_j", "rate_i", "rate_j"))


def _flux_lines(law: Law, terms: Terms) -> list[str]:
    """flux = what multiplies - V_j F in d rho_i / dt; only between fluid particles (`mixing`)."""
    lines = []
    if law.flux == "delta":  # less what a linear density would give
        terms.need(*(f"g{a}" for a in law.axes))
        lines += [f"    d_rho = fma(g{a}_i + g{a}_j, d{a}, d_rho)" for a in law.axes]  # g is half the gradient
    if law.flux == "fourtakas":  # less what rest under gravity would give: slope = rho / (2 c^2), trapezoidal rule
        terms.need("slope")
        drop = f"gravity{law.axes[-1]} * d{law.axes[-1]}"
        for a in law.axes[-2::-1]:
            drop = f"fma(d{a}, gravity{a}, {drop})"
        lines += [f"    d_rho = fma(slope_i + slope_j, {drop}, d_rho)"]
    strength = "flux_strength * r" if law.flux == "rusanov" else "flux_strength"
    return [*lines, f"    flux = d_rho * ({strength})", "    flux = select(mixing, flux, 0.0)"]


def gradient(law: Law, terms: Terms) -> None:
    """Sums for the renormalised density gradient: - sum V_j F r r^T and sum V_j (rho_j - rho_i) F r_ij, of fluid."""
    terms.need("excess", "volume")
    terms.lines += [
        "    fluid = F",
        "    fluid = select(mixing, fluid, 0.0)",
        "    from_j, from_i = volume_j * fluid, volume_i * fluid",
        "    step = excess_j - excess_i",
    ]
    for k, a in enumerate(law.axes):
        for b in law.axes[k:]:
            terms.lines.append(f"    m{a}{b} = -(d{a} * d{b})")
            terms.sums.append((f"m{a}{b}", "from_j", "from_i", f"m{a}{b}", f"m{a}{b}"))
        terms.lines.append(f"    b{a} = step * d{a}")
        terms.sums.append((f"b{a}", "from_j", "from_i", f"b{a}", f"b{a}"))


def strain(law: Law, terms: Terms) -> None:
    """Sums of the velocity gradient: d v_b / d x_a = sum V_j (v_j - v_i)_b F r_a."""
    _relative_velocity(law, terms)
    terms.need("volume")
    terms.lines += ["    by_j, by_i = -(volume_j * F), -(volume_i * F)"]
    for a in law.axes:
        for b in law.axes:
            terms.lines.append(f"    w{a}{b} = d{a} * d{b}v")
            terms.sums.append((f"w{a}{b}", "by_j", "by_i", f"w{a}{b}", f"w{a}{b}"))


def matrix(law: Law, terms: Terms) -> None:
    """- sum V_j F r r^T, whose inverse renormalises gradients (Randles and Libersky 1996)."""
    terms.need("volume")
    terms.lines += ["    by_j, by_i = -(volume_j * F), -(volume_i * F)"]
    for k, a in enumerate(law.axes):
        for b in law.axes[k:]:
            terms.lines.append(f"    k{a}{b} = d{a} * d{b}")
            terms.sums.append((f"k{a}{b}", "by_j", "by_i", f"k{a}{b}", f"k{a}{b}"))


def shifting(law: Law, terms: Terms) -> None:
    """Sums of Sun et al. 2017 (9), sum V_j (1 + 0.2 (W / W(dp))^4) F r_ij, and - sum V_j F r^2: d where fluid is all
    around.
    """
    terms.need("volume")
    _crowding(law, terms)
    terms.lines += [
        "    apart = F * fma(crowding, 0.2, 1.0)",
        "    apart_i, apart_j = volume_j * apart, -(volume_i * apart)",
        "    around_i, around_j, r_sq = -(volume_j * F), -(volume_i * F), r2",
    ]
    terms.sums += [(f"h{a}", "apart_i", "apart_j", f"d{a}", f"d{a}") for a in law.axes]
    terms.sums.append(("around", "around_i", "around_j", "r_sq", "r_sq"))


TERMS = {
    "momentum": momentum,
    "continuity": continuity,
    "gradient": gradient,
    "strain": strain,
    "matrix": matrix,
    "shifting": shifting,
}


def sums_of(law: Law, names: Sequence[str]) -> list[str]:
    """What a pass of these terms leaves in sums[k]."""
    return [entry[0] for entry in collect(law, names).sums]


def collect(law: Law, names: Sequence[str]) -> Terms:
    terms = Terms()
    for name in names:
        TERMS[name](law, terms)
    return terms
