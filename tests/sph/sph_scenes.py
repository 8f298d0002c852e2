"""Small scenes for the tests of the engine, and the pair sums in plain numpy."""

import numpy as np

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.configure import configure
from sph.kernels.marks import CODES, REPULSIVE
from sph.physics.smoothing import SMOOTHING
from sph.physics.waves import cleary_constant
from sph.step import Sph

TEXT = """
simulation = {{ dimensions = {d}; end_time = 1.0; integrator = "{integrator}"; cfl = {cfl}; {step} }};
domain = {{ low = {domain_low}; high = {high}; periodic = {periodic}; outflow = {outflow}; }};
gravity = {gravity};
fluid = ( {{ name = "water"; dynamic_viscosity = {viscosity}; velocity = {velocity}; initial_pressure = "{pressure}";
            shape = {{ box = {{ low = {low}; high = {fill}; }}; }}; }} );
eos = {{ sound_speed = {sound}; }};
numerics = {{ spacing = {spacing}; smoothing = {smoothing}; kernel = "{kernel}"; density_flux = "{flux}";
             viscosity_form = "{form}"; artificial_viscosity = {alpha}; precision = "{precision}";
             balance_period = {balance}; tensile_correction = {tensile}; gradient_correction = {corrected};
             shifting = {shifting}; }};
{more}
"""


def listed(values):
    return "[" + ", ".join(f'"{v}"' if isinstance(v, str) else repr(float(v)) for v in values) + "]"


def text(d=2, size=1.0, fill=0.5, spacing=0.05, gravity=None, periodic=(), more="", **settings):
    chosen = {
        "integrator": "symplectic", "cfl": 0.3, "viscosity": 0.0, "velocity": (0.0,) * d, "pressure": "hydrostatic",
        "smoothing": 1.3, "kernel": "wendland2", "flux": "molteni", "form": "artificial", "alpha": 0.1,
        "precision": "double", "balance": 100, "tensile": 0.0, "corrected": "false", "shifting": "false",
        "step": "", "sound": 20.0, "low": (0.0,) * d, "outflow": (),
    } | settings  # fmt: skip
    chosen |= {name: listed(chosen[name]) for name in ("velocity", "low", "outflow")}
    sizes, fills = np.broadcast_to(size, d), np.broadcast_to(fill, d)
    gravity = (0.0,) * (d - 1) + (-9.81,) if gravity is None else gravity
    return TEXT.format(
        d=d, domain_low=listed((0.0,) * d), high=listed(sizes), fill=listed(fills), gravity=listed(gravity),
        periodic=listed(periodic), spacing=spacing, more=more, **chosen,
    )  # fmt: skip


def torn():
    """A case: water in a tank, above it a drop of two particles at 1.32 rho0, which leaves the domain soon."""
    drop = """fluid = ( { name = "drop"; surface = 31.0; velocity = [18.0, 0.0];
        shape = { box = { low = [0.5, 0.8]; high = [0.7, 0.9]; }; }; }, { name ="""
    whole = text(size=(1.0, 1.2), fill=(0.8, 0.5), spacing=0.1, more=tank(2, size=(1.0, 0.6)), outflow=("x+",))
    return whole.replace("fluid = ( { name =", drop)


def config(case=None, **settings):
    return configure(loads(case or text(**settings)))


def engine(world=None, threads=1, **settings):
    return Sph(config(**settings), world or World.alone(), Pool(threads), Timers())


def jitter(sph, amount=0.2, speed=1.0, density=5.0, seed=1):
    """Disorder the particles, in a way that depends on their ids alone."""
    storage, d = sph.storage, sph.scene.dimensions
    noise = np.random.default_rng(seed).uniform(-1, 1, (sph.scene.n_fluid, 2 * d + 1))
    fluid = storage.fluid_slots
    noise = noise[storage.key[fluid] // CODES].T
    storage.x[:, fluid] += amount * sph.scene.spacing * noise[:d]
    storage.v[:, fluid] += speed * noise[d : 2 * d]
    storage.drho[fluid] += density * noise[2 * d]
    sph.tasks.each(sph.motion.rewrap)
    sph.migrate()
    sph.sort()


def tank(d=2, kind="pressure-continuity", size=1.0, more=""):
    """A wall around the domain of this size, open on top."""
    high = [float(value) for value in np.broadcast_to(size, d)]
    return f"""wall = ( {{ name = "tank"; type = "{kind}"; measure_force = true; {more}
        shape = {{ box = {{ low = {[0.0] * d}; high = {high}; open = ["{"xyz"[d - 1]}+"]; }}; }}; }} );"""


def column(sph, name):
    """A column of the own particles; a [d, n] and rate [n] of the last pair sums."""
    storage, sums = sph.storage, sph.sums
    if name == "a":
        return sums.forces_on(storage.own_slots) / storage.own_values("m")
    if name == "rate":
        rates = sph.tasks.arena["sums"][sums.rate, storage.own_slots] * sph.tasks.arena["factors"][1]
        return np.where(storage.own_values("flags") & REPULSIVE, 0.0, rates)
    return storage.own_values(name)


def by_id(sph, *names):
    """Columns of the particles in order of their ids."""
    order = np.argsort(sph.storage.own_values("id"))
    return [column(sph, name)[..., order] for name in names]


class Reference:
    """All pairs at once, in SI units: acceleration without gravity and d rho / dt."""

    def __init__(self, sph):
        self.scene, self.numerics = sph.scene, sph.scene.config.numerics
        x, v, self.drho, self.m = by_id(sph, "x", "v", "drho", "m")
        self.rho = self.scene.rho0 + self.drho
        self.dx, self.dv = x[:, :, None] - x[:, None, :], v[:, :, None] - v[:, None, :]
        for k in np.flatnonzero(sph.slabs.domain.periodic):
            length = sph.slabs.domain.lengths[k]
            self.dx[k] -= length * np.rint(self.dx[k] / length)
        d, h = self.scene.dimensions, self.scene.h
        self.r = np.sqrt(np.sum(self.dx**2, axis=0))
        self.f = SMOOTHING[self.scene.kernel].gradient(self.r / h, d) / h ** (d + 2)
        np.fill_diagonal(self.f, 0.0)
        self.vd = np.sum(self.dx * self.dv, axis=0)
        self.g = self.scene.acceleration[list(self.scene.axes)]

    def acceleration(self):
        scene, h = self.scene, self.scene.h
        p = scene.pressure(self.drho) + scene.config.eos.background_pressure
        push = (p / self.rho**2)[:, None] + (p / self.rho**2)[None, :]
        near = self.vd / (self.r**2 + 0.01 * h * h)
        mean = 0.5 * (1 / self.rho[:, None] + 1 / self.rho[None, :])
        push -= self.numerics.artificial_viscosity * scene.c0 * h * np.minimum(near, 0.0) * mean
        if self.numerics.viscosity_form == "cleary" and scene.viscosity:
            xi = cleary_constant(scene.kernel, scene.dimensions, self.numerics.smoothing)
            push -= 2 * xi * scene.viscosity / (self.rho[:, None] * self.rho[None, :]) * near
        drag = 0.0
        if self.numerics.viscosity_form == "morris" and scene.viscosity:
            drag = 2 * scene.viscosity * np.einsum("j,ij,kij->ki", self.m / self.rho, self.f, self.dv) / self.rho
        if self.numerics.tensile_correction:
            w = SMOOTHING[scene.kernel].w(self.r / h, 1.0) / SMOOTHING[scene.kernel].w(scene.spacing / h, 1.0)
            tension = self.numerics.tensile_correction * np.where(p < 0, -p, 0.05 * p) / self.rho**2
            push += (tension[:, None] + tension[None, :]) * w**4
        if self.numerics.gradient_correction:
            plain = (p / self.rho**2)[:, None] + (p / self.rho**2)[None, :]
            turned = np.einsum("iab,bij->aij", self.matrix(), self.dx) * (p / self.rho**2)[:, None]
            turned += np.einsum("jab,bij->aij", self.matrix(), self.dx) * (p / self.rho**2)[None, :]
            return drag - np.einsum("j,ij,kij->ki", self.m, self.f, turned + (push - plain) * self.dx)
        force = drag - np.einsum("j,ij,ij,kij->ki", self.m, push, self.f, self.dx)
        if self.numerics.viscosity_form == "strain-rate" and scene.viscosity:
            force += self._stress()
        return force

    def matrix(self):
        sums = -np.einsum("j,ij,aij,bij->iab", self.m / self.rho, self.f, self.dx, self.dx)
        good = np.linalg.det(sums) > 0.1
        return np.where(good[:, None, None], np.linalg.inv(sums), np.eye(self.scene.dimensions))

    def _stress(self):
        d, volume = self.scene.dimensions, self.m / self.rho
        w = -np.einsum("j,ij,aij,bij->abi", volume, self.f, self.dx, self.dv)
        strain = w + w.transpose(1, 0, 2) - 2 / d * np.einsum("aai->i", w) * np.eye(d)[:, :, None]
        t = self.scene.viscosity * strain / self.rho**2
        return np.einsum("j,ij,abij,bij->ai", self.m, self.f, t[:, :, :, None] + t[:, :, None, :], self.dx)

    def rate(self):
        scene, h, c = self.scene, self.scene.h, self.scene.c0
        volume = self.m / self.rho
        vd = self.vd
        if self.numerics.gradient_correction:
            vd = np.einsum("aij,iab,bij->ij", self.dv, self.matrix(), self.dx)
        result = self.rho * np.einsum("j,ij,ij->i", volume, self.f, vd)
        flux, k = self.numerics.density_flux, self.numerics.flux_coefficient
        step = self.rho[None, :] - self.rho[:, None]
        if flux == "none":
            return result
        if flux == "rusanov":
            return result - k * c * np.einsum("j,ij,ij,ij->i", volume, self.f, self.r, step)
        if flux == "fourtakas":
            slope = self.rho / c**2 * (self.rho / scene.rho0) ** (1 - scene.gamma)
            step = step + 0.5 * (slope[:, None] + slope[None, :]) * np.einsum("k,kij->ij", self.g, self.dx)
        if flux == "delta":
            matrix = -np.einsum("j,ij,aij,bij->iab", volume, self.f, self.dx, self.dx)
            plain = np.einsum("j,ij,ij,aij->ia", volume, self.f, step, self.dx)
            gradient = np.linalg.solve(matrix, plain[:, :, None])[:, :, 0].T
            step = step + 0.5 * np.einsum("aij,aij->ij", gradient[:, :, None] + gradient[:, None, :], self.dx)
        return result - 2 * k * h * c * np.einsum("j,ij,ij->i", volume, self.f, step)
