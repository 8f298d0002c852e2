"""Small scenes for the tests of the engine."""

import re

import numpy as np

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.configure import configure
from sph.kernels.marks import CODES, REPULSIVE
from sph.physics.reference import Reference
from sph.step import Sph

TEXT = """
simulation = {{ dimensions = {d}; end_time = 1.0; integrator = "{integrator}"; cfl = {cfl}; {step} }};
domain = {{ low = {domain_low}; high = {high}; periodic = {periodic}; outflow = {outflow}; }};
gravity = {gravity};
fluid = ( {{ name = "water"; dynamic_viscosity = {viscosity}; velocity = {velocity}; initial_pressure = "{pressure}";
            shape = {{ box = {{ low = {low}; high = {fill}; }}; }}; }} );
eos = {{ sound_speed = {sound}; gamma = {gamma}; }};
numerics = {{ spacing = {spacing}; smoothing = {smoothing}; kernel = "{kernel}"; density_flux = "{flux}";
             viscosity_form = "{form}"; artificial_viscosity = {alpha}; precision = "{precision}";
             balance_period = {balance}; tensile_correction = {tensile}; gradient_correction = {corrected};
             shifting = {shifting}; continuity = "{continuity}"; }};
{more}
"""

TANK = {"size": (1.0, 1.2), "fill": (1.0, 0.5), "spacing": 0.1}
EXTRAPOLATED = re.compile("extrapolated|body = ")  # walls whose density follows from the fluid


def listed(values):
    return "[" + ", ".join(f'"{v}"' if isinstance(v, str) else repr(float(v)) for v in values) + "]"


def text(d=2, size=1.0, fill=0.5, spacing=0.05, gravity=None, periodic=(), more="", **settings):
    """A case. Its flux is by default that of most tests of such walls: kernels are compiled once for all of them."""
    chosen = {
        "integrator": "symplectic", "cfl": 0.3, "viscosity": 0.0, "velocity": (0.0,) * d, "pressure": "hydrostatic",
        "smoothing": 1.3, "kernel": "wendland2", "flux": "delta" if EXTRAPOLATED.search(more) else "molteni",
        "form": "artificial", "alpha": 0.1, "precision": "double", "balance": 100, "tensile": 0.0,
        "corrected": "false", "shifting": "false",
        "continuity": "volumes", "step": "", "sound": 20.0, "gamma": 7.0, "low": (0.0,) * d, "outflow": (),
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


def layers(densities=(1000.0, 400.0), viscosities=(0.0, 0.0), swapped=False, ambient=None, **settings):
    """A case: the fluid of `text`, its lower and upper half of two liquids; swapped: named the other way round. The
    upper one is a gas where an ambient pressure in Pa is given.
    """
    whole = text(**settings)
    head, rest = whole.split("fluid = (", 1)
    box, tail = rest.split(");", 1)
    low, high = (re.findall(side + r" = \[(.*?)\]", box)[-1].split(", ") for side in ("low", "high"))
    middle = repr((float(low[-1]) + float(high[-1])) / 2)
    names, found = ["water", "oil"][:: -1 if swapped else 1], []
    for k, (name, density, viscosity) in enumerate(zip(names, densities, viscosities)):
        side, end = ("high", high) if k == 0 else ("low", low)
        one = re.sub(rf"{side} = \[.*?\]", f"{side} = [{', '.join([*end[:-1], middle])}]", box)
        gas = "true" if ambient and k == 1 else "false"
        one = one.replace('name = "water"', f'name = "{name}"; density = {density}; gas = {gas}')
        found.append(re.sub(r"(dynamic_viscosity) = [^;]*", rf"\1 = {viscosity}", one))
    tail = tail.replace("eos = {", f"eos = {{ ambient_pressure = {ambient};") if ambient else tail
    return head + "fluid = (" + ",".join(found[:: -1 if swapped else 1]) + ");" + tail


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


def water(**settings):
    """Water at rest in a tank, open on top; one kind of scene, so that it is compiled once."""
    chosen = TANK | settings
    return engine(more=tank(2, size=chosen["size"]), **chosen)


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


def reference(sph):
    """The pair sums of all particles in order of their ids, in plain numpy."""
    columns, scene = by_id(sph, "x", "v", "drho", "m"), sph.scene
    axes = list(scene.axes)
    period = np.where(scene.periodic, scene.high - scene.low, 0.0)[axes]
    of = np.sort(sph.storage.own_values("id"))
    return Reference(scene.config, *columns, scene.acceleration[axes], period, of=sph.storage.liquid(of))
