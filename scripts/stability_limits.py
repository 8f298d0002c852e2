#!/usr/bin/env python3
"""Where the schemes stop being stable: measured by bisection of whole steps of the simulators, beside theory.

python scripts/stability_limits.py [WORD ...]        rows whose text holds one of the words; a Markdown table

sph: noise of 1e-8 c0 on a periodic lattice at rest; theory is von Neumann's for the same sums (sph.limits).
lbmdem: a grain between fixed ones; noise on a uniform flow, theory the spectral radius of streaming and of the Jacobian
of the collision itself; the viscosity that a shear wave has; shear layers (Minion & Brown 1997), which have no theory:
beside them stands the limit that `check` refuses beyond.
plasma: the cold wave, growth beyond omega_p dt = 2 (leap frog).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers

if TYPE_CHECKING:
    from lbmdem.fluid.fluid import Fluid
    from sph.case.config import SphConfig

WIDTH = 1.004  # of a bracket that is a limit
WIDEST = 4.0  # times theory


@dataclass(frozen=True, slots=True)
class Row:
    """One limit: `stable(x)` runs the scheme at this value of the number. within: of theory, relative; None: none."""

    program: str
    what: str
    number: str
    theory: Callable[[], float]
    stable: Callable[[float], bool]
    within: float | None = 0.05
    above: bool = False  # stable above the limit instead of below


def measured(row: Row, theory: float) -> float:
    """Geometric bisection from a bracket about theory; nan where its ends do not differ."""
    low, high = theory / 1.1, theory * 1.1
    while row.stable(low) == row.above:
        low /= 1.5
        if low < theory / WIDEST:
            return math.nan
    while row.stable(high) != row.above:
        high *= 1.5
        if high > theory * WIDEST:
            return math.nan
    while high > WIDTH * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if row.stable(middle) == row.above else (middle, high)
    return math.sqrt(low * high)


# ------------------------------------------------------------------------------------------------------------- sph

SIDE, SMOOTHING, C0, NOISE = 24, 1.5, 20.0, 1e-8
GROWN = 1e3  # of the energy of the noise
STEPS = {"euler": 6000}  # 1500 for the others: what theory calls growth, 1e-3 of the amplitude per step, Euler's waves
# reach long before they grow fast
LATTICE = """
simulation = {{ dimensions = 2; end_time = 1.0; integrator = "{integrator}"; time_step = {dt!r}; }};
domain = {{ low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x", "y"]; }};
fluid = ( {{ name = "water"; dynamic_viscosity = {viscosity!r}; initial_pressure = "zero";
            shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 1.0]; }}; }}; }} );
eos = {{ sound_speed = {c0}; }};
numerics = {{ spacing = {spacing!r}; smoothing = {smoothing}; kernel = "wendland2";
              density_flux = "{flux}"; viscosity_form = "{form}"; }};
"""


def lattice(integrator: str, flux: str, form: str = "none", slow: float = 0.0, *, courant: float) -> SphConfig:
    """Completed case; slow: nu / (c0 h)."""
    from sph.configure import configure

    h = SMOOTHING / SIDE
    text = LATTICE.format(
        integrator=integrator, flux=flux, form=form, dt=courant * h / C0, c0=C0, spacing=1.0 / SIDE,
        smoothing=SMOOTHING, viscosity=1000.0 * slow * C0 * h,
    )  # fmt: skip
    return configure(loads(text))


def lattice_theory(*settings: Any) -> float:
    """Courant number below which no wave grows by 1e-3 in a step."""
    from sph.physics import stability

    config = lattice(*settings, courant=0.1)
    return stability.limit_of(config.simulation.integrator, *stability.decays(config, True))


def lattice_stable(settings: tuple, courant: float) -> bool:
    """Whether noise stays noise."""
    from sph.step import Sph

    app = Sph(lattice(*settings, courant=courant), World.alone(), POOL, Timers())
    storage, rng = app.storage, np.random.default_rng(1)
    for name, scale in (("v", C0), ("drho", app.scene.rho0)):
        column = storage.own_values(name)
        storage.set_own_values(name, column + NOISE * scale * rng.uniform(-1, 1, column.shape))
    app.resume()

    def energy() -> float:
        v, drho = storage.own_values("v"), storage.own_values("drho")
        return float(np.sum(v**2) + np.sum((C0 * drho / app.scene.rho0) ** 2))

    start = energy()
    try:
        for _ in range(STEPS.get(settings[0], 1500)):
            app.step()
            if not energy() < GROWN * start:
                return False
    except Diverged:
        return False
    return True


def sph_rows() -> Iterator[Row]:
    for flux in ("none", "rusanov"):
        for integrator in ("euler", "predictor-corrector", "symplectic", "rk3-tvd"):
            settings = (integrator, flux)
            if settings != ("euler", "none"):  # whose waves all grow, at any step
                yield sph_row(f"{integrator}, {flux} flux", "c0 dt/h", settings)
    for form in ("strain-rate", "cleary"):
        for integrator in ("euler", "predictor-corrector", "symplectic", "rk3-tvd"):
            slow = 20.0  # nu / (c0 h): waves of sound are far from their limit
            yield sph_row(f"{integrator}, {form} viscosity", "nu dt/h2", (integrator, "none", form, slow), slow)


def sph_row(what: str, number: str, settings: tuple, scale: float = 1.0) -> Row:
    return Row("sph", what, number, lambda: scale * lattice_theory(*settings),
               lambda x: lattice_stable(settings, x / scale))  # fmt: skip


# ---------------------------------------------------------------------------------------------------------- lbmdem


def dem_stable(contacts: int, damping: float, dt: float) -> bool:
    """A grain between fixed ones that all touch it along x; dt in sqrt(m/k)."""
    from hpcpic.core.physics.contact_law import ContactLaw
    from lbmdem.grains.dem import Dem

    radius, stiffness, mass, small = 0.05, 1e4, 1.0, 1e-9
    overlap, left = 0.01 * radius, contacts - contacts // 2
    at, n = 2 * radius - overlap, contacts + 1
    x = np.full((n, 2), 0.5)
    x[1:, 0] += np.where(np.arange(contacts) < left, -at, at)
    columns = {
        "x": x, "v": np.zeros((n, 2)), "omega": np.zeros((n, 1)), "radius": np.full(n, radius),
        "mass": np.full(n, mass), "inertia": np.full(n, 0.5 * mass * radius**2), "fixed": np.arange(n) > 0,
    }  # fmt: skip
    domain = Domain((1.0, 1.0), (12, 4), (True, True), (0, 12))
    scene = Dem(World.alone(), POOL, domain, columns, ContactLaw(stiffness, damping), (), ())
    own = scene.grains.ids == 0
    balance = np.zeros_like(scene.grains.x)
    balance[own, 0] = -stiffness * overlap * (2 * left - contacts)
    scene.grains.x[own, 0] += small
    for _ in range(20):  # a grain that is thrown off may be back by chance at any one time
        scene.advance(dt * math.sqrt(mass / stiffness), 50, balance)
        if not abs(scene.grains.x[scene.grains.ids == 0][0, 0] - 0.5) < 1e3 * small:
            return False
    return True


def dem_rows() -> Iterator[Row]:
    from hpcpic.core.physics.contact_law import step_limit

    for damping in (0.0, 0.5, 0.9):
        for contacts in (1, 2, 4, 6):
            what = f"Verlet, {contacts} contact{'s' if contacts > 1 else ''}, damping {damping:g}"
            yield Row("lbmdem", what, "dt sqrt(k/m)", partial(step_limit, damping, contacts),
                      partial(dem_stable, contacts, damping))  # fmt: skip


FLOW = 32  # nodes of a side of the uniform flow


def fluid(collision: str, tau: float, n: int) -> Fluid:
    from lbmdem.fluid.fluid import Fluid
    from lbmdem.physics.velocity_sets import LATTICES

    domain = Domain((1.0, 1.0), (n, n), (True, True), (0, n))
    return Fluid(World.alone(), POOL, domain, LATTICES["D2Q9"], tau=tau, collision=collision)


def collision_jacobian(collision: str, tau: float, u: float) -> NDArray[np.float64]:
    """d f'/d f [9, 9] of the collision at equilibrium with the velocity u along x: uniform, streaming is nothing."""
    box = fluid(collision, tau, 8)
    box.set_equilibrium(1.0, np.broadcast_to((u, 0.0), (8, 8, 2)))
    rest, small = box.populations().copy(), 1e-6
    found = np.empty((9, 9))
    for i in range(9):
        sides = []
        for sign in (1.0, -1.0):
            changed = rest.copy()
            changed[i] += sign * small
            box.set_populations(changed)
            box.step()
            sides.append(box.populations().reshape(9, -1)[:, 0].copy())
            if box.iteration % 2:
                box.step()
        found[:, i] = (sides[0] - sides[1]) / (2 * small)
    return found


def flow_radius(collision: str, tau: float, u: float) -> float:
    """Spectral radius over all waves of a box of FLOW x FLOW."""
    from lbmdem.physics.velocity_sets import LATTICES

    jacobian, e = collision_jacobian(collision, tau, u), LATTICES["D2Q9"].e.astype(float)
    k = 2 * np.pi / FLOW * np.stack(np.meshgrid(np.arange(FLOW), np.arange(FLOW)), -1).reshape(-1, 2)
    step = np.exp(-1j * k @ e.T)[:, :, None] * jacobian
    return float(np.abs(np.linalg.eigvals(step)).max())


def flow_theory(collision: str, tau: float) -> float:
    """The velocity beyond which a wave on the flow grows."""
    low, high = 0.01, 0.7
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if flow_radius(collision, tau, middle) < 1 + FLOW_GROWTH else (low, middle)
    return low


FLOW_STEPS, FLOW_GROWTH = 4000, 1e-3  # per step


def flow_stable(collision: str, tau: float, u: float) -> bool:
    """Whether noise on the flow stays noise."""
    box = fluid(collision, tau, FLOW)
    noise = 1e-9 * np.random.default_rng(1).uniform(-1, 1, (FLOW, FLOW, 2))
    box.set_equilibrium(1.0, noise + np.array([u, 0.0]))
    box.advance(FLOW_STEPS)
    populations = box.populations()
    away = populations - populations.mean(axis=(1, 2), keepdims=True)
    return bool(np.isfinite(away).all() and np.abs(away).max() < 1e-9 * math.exp(0.5 * FLOW_GROWTH * FLOW_STEPS))


def layers_stable(collision: str, mach: float, reynolds: float, n: int = 64) -> bool:
    """Doubly periodic shear layers, two turn-overs; reynolds: u dx/nu."""
    u0 = mach / math.sqrt(3.0)
    box = fluid(collision, 0.5 + 3.0 * u0 / reynolds, n)
    y, x = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n, indexing="ij")
    u = np.empty((n, n, 2))
    u[..., 0] = u0 * np.where(y <= 0.5, np.tanh(80 * (y - 0.25)), np.tanh(80 * (0.75 - y)))
    u[..., 1] = 0.05 * u0 * np.sin(2 * np.pi * (x + 0.25))
    box.set_equilibrium(1.0, u)
    box.advance(int(2 * n / u0))
    _, velocity = box.moments()
    return bool(np.isfinite(velocity).all() and np.abs(velocity).max() < 5 * u0)


def decays(collision: str, tau: float) -> bool:
    """Whether a shear wave decays: the sign of the viscosity."""
    n, steps = 16, 100
    box = fluid(collision, tau, n)
    wave = np.sin(2 * np.pi * (np.arange(n) + 0.5) / n)
    u = np.zeros((n, n, 2))
    u[..., 0] = 1e-3 * wave[:, None]
    box.set_equilibrium(1.0, u)
    before = float(wave @ box.moments()[1][:, 0, 0])
    box.advance(steps)
    return bool(wave @ box.moments()[1][:, 0, 0] < before)


def fluid_rows() -> Iterator[Row]:
    from lbmdem.physics.collision import COLLISIONS

    wave = partial(decays, "BGK")
    yield Row("lbmdem", "BGK, a shear wave decays", "tau", lambda: 0.5, wave, WIDTH - 1.0, above=True)
    for collision, taus in (("BGK", (0.51, 0.6, 1.0)), ("TRT", (0.51, 0.6, 1.0)), ("central", (0.51, 0.6, 1.0))):
        for tau in taus:
            yield Row("lbmdem", f"{collision}, tau {tau:g}, uniform flow", "u dt/dx",
                      partial(flow_theory, collision, tau), partial(flow_stable, collision, tau))  # fmt: skip
    for collision in ("BGK", "TRT"):
        for mach in (0.05, 0.1, 0.2):
            yield Row("lbmdem", f"{collision}, shear layers, Ma {mach:g}", "u dx/nu",
                      partial(getattr, COLLISIONS[collision], "grid_reynolds"),
                      partial(layers_stable, collision, mach), None)  # fmt: skip


# ---------------------------------------------------------------------------------------------------------- plasma

WAVE = """
simulation = {{ dimensions = 1; cycles = 1; time_step = {dt!r}; space_length = [64.0]; }};
grid = {{ points = [64]; }};
numerics = {{ shape = "{shape}"; gradient = "{gradient}"; }};
species = ( {{ name = "electrons"; particles = 1024; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
              init_method = "quiet"; perturbation = {{ mode = [1]; amplitude = 1.0e-5; }}; }} );
"""


def wave_stable(shape: str, gradient: str, dt: float) -> bool:
    """Whether the energy of a cold wave stays."""
    from hpcpic.plasma.configure import configure
    from hpcpic.plasma.step import Plasma

    app = Plasma(configure(loads(WAVE.format(dt=dt, shape=shape, gradient=gradient))), World.alone(), POOL,
                 Timers())  # fmt: skip
    start = app.scalars()["energy_field"]
    for _ in range(60):
        for _ in range(5):
            app.step()
        if app.scalars()["energy_field"] > 30 * start:
            return False
    return True


def plasma_rows() -> Iterator[Row]:
    """cos(k dx / 2) of the longest wave and its assignment to the grid make the frequency less than wp by 1e-3."""
    for shape, gradient in (("CIC", "difference"), ("TSC", "difference"), ("CIC", "spectral"), ("TSC", "spectral")):
        yield Row("hpcpic", f"leap frog, {shape}, {gradient}", "wp dt", lambda: 2.0,
                  partial(wave_stable, shape, gradient))  # fmt: skip


# ----------------------------------------------------------------------------------------------------------- table

POOL = Pool(1)


def rows() -> list[Row]:
    return [*plasma_rows(), *sph_rows(), *dem_rows(), *fluid_rows()]


def line(row: Row) -> tuple[str, float]:
    """A row of the table, and measured over theory."""
    theory = row.theory()
    found = measured(row, theory)
    ratio = found / theory
    source = "" if row.within is not None else " (no theory: `check` refuses beyond)"
    return f"| {row.program} | {row.what} | {row.number} | {theory:.4g}{source} | {found:.4g} | {ratio:.3f} |", ratio


def main() -> int:
    words, worst = sys.argv[1:], 0.0
    print("| program | scheme | number | theory | measured | measured / theory |\n|---|---|---|---|---|---|")
    for row in rows():
        if words and not any(word in f"{row.program} {row.what}" for word in words):
            continue
        text, ratio = line(row)
        print(text, flush=True)
        if row.within is not None:
            worst = max(worst, abs(ratio - 1.0) / row.within) if ratio == ratio else math.inf
    print(f"\nworst departure from theory: {worst:.2f} of what is allowed")
    return 0 if worst <= 1.0 else 3


if __name__ == "__main__":
    sys.exit(main())
