"""Fills in what the settings of an SPH case determine: names, vectors of full length, domain, c0, Courant number."""

from collections.abc import Iterable

from hpcpic.core.case.words import only_seconds
from sph.case import geometry
from sph.case.config import Domain, SphConfig, Wall, name_of, shapes_of
from sph.physics.fluxes import FLUXES
from sph.physics.integrators import INTEGRATORS
from sph.physics.liquids import liquids_of
from sph.physics.stability import courant_limit
from sph.physics.viscosities import viscosity_of
from sph.physics.wall_rules import WALL_RULES
from sph.setup import flows
from sph.setup.speeds import speed_scale
from sph.setup.tanks import free_surface, open_sides

HELD = 0.05  # of rho v^2, by which gas may lie below its pressure of rest before particles leave gaps
SAFETY = 0.6  # of the stability limit, where no Courant number is given


def completed(config: SphConfig) -> SphConfig:
    d = config.dimensions
    zeros = (0.0,) * d
    config = config.model_copy(
        update={
            "simulation": config.simulation.model_copy(update={"dimensions": d}),
            "gravity": config.gravity or zeros,
            "body_force": config.body_force or zeros,
            "fluid": tuple(named("fluid", i, _fluid(fluid, d)) for i, fluid in enumerate(config.fluid)),
            "wall": tuple(named("wall", i, _wall(wall, d)) for i, wall in enumerate(config.wall)),
            "output": config.output.model_copy(
                update={"period": only_seconds(config.output.period, config.output.every)}
            ),
            "gauge": tuple(named("gauge", i, _gauge(gauge)) for i, gauge in enumerate(config.gauge)),
            "inlet": tuple(named("inlet", i, inlet) for i, inlet in enumerate(config.inlet)),
            "outlet": tuple(named("outlet", i, outlet) for i, outlet in enumerate(config.outlet)),
        }
    )
    config = config.model_copy(update={"domain": domain_of(config), "numerics": _numerics(config)})
    config = config.model_copy(update={"wall": _wall_types(config)})
    config = config.model_copy(update={"eos": _eos(config)})
    simulation = config.simulation
    if simulation.cfl is None:
        cfl = float(f"{SAFETY * courant_limit(config):.2g}")
        config = config.model_copy(update={"simulation": simulation.model_copy(update={"cfl": cfl})})
    return config


def named(kind: str, i: int, group):
    return group.model_copy(update={"name": name_of(kind, i, group)})


def _fluid(fluid, d: int):
    flow = fluid.flow
    if flow:
        flow = flow.model_copy(update={"centre": flows.centre_of(fluid, flow)})
    return fluid.model_copy(update={"velocity": fluid.velocity or (0.0,) * d, "flow": flow})


def _wall(wall, d: int):
    update: dict = {"torque_about": wall.torque_about or geometry.middle(wall.shape)}
    zeros = (0.0,) * d
    if wall.body:
        turning = wall.body.angular_velocity or (0.0,) * (1 if d == 2 else 3)
        body = {"velocity": wall.body.velocity or zeros, "angular_velocity": turning}
        update |= {"body": wall.body.model_copy(update=body), "measure_force": True}
    if wall.motion:
        motion = {name: getattr(wall.motion, name) or zeros for name in ("velocity", "amplitude")}
        update["motion"] = wall.motion.model_copy(update=motion)
    return wall.model_copy(update=update)


def _wall_types(config: SphConfig) -> tuple[Wall, ...]:
    """The walls of a case of which fluids and numerics are completed, with their types."""
    form = viscosity_of(config.numerics.viscosity_form)
    sticks = form.physical and any(fluid.dynamic_viscosity for fluid in config.fluid)
    kind = "extrapolated-no-slip" if sticks else "extrapolated-free-slip"
    return tuple(wall if wall.type else wall.model_copy(update={"type": kind}) for wall in config.wall)


def _gauge(gauge):
    return gauge.model_copy(update={"axis": gauge.axis or gauge.kind.axis})


def domain_of(config: SphConfig) -> Domain:
    """The domain as given, else the box around fluids and walls."""
    domain = config.domain
    boxes = [geometry.bounds(shape) for shape in shapes_of(config)] or [((0.0,), (1.0,))]
    boxes += [(opening.low, opening.high) for opening in (*config.inlet, *config.outlet)]

    def outermost(points: Iterable, choose) -> tuple[float, ...]:
        return tuple(choose(xs) for xs in zip(*points))

    low = domain.low or outermost((low for low, _ in boxes), min)
    high = domain.high or outermost((high for _, high in boxes), max)
    return domain.model_copy(update={"low": low, "high": high})


def _viscosity_form(config: SphConfig) -> str:
    """The form for a viscous fluid: right at a free surface, if there is one and the walls know it."""
    full = viscosity_of("full-stress")
    known = all(WALL_RULES[wall.type].knows(full) for wall in config.wall if wall.type)
    return "full-stress" if known and free_surface(config) else "morris"


def _numerics(config: SphConfig):
    numerics = config.numerics
    viscous = any(fluid.dynamic_viscosity for fluid in config.fluid)
    form = numerics.viscosity_form or (_viscosity_form(config) if viscous else "artificial")
    flux, alpha = numerics.flux_coefficient, numerics.artificial_viscosity
    shifts = viscosity_of(form).laplacian and not numerics.gradient_correction and not liquids_of(config).several
    shifts &= INTEGRATORS[config.simulation.integrator].split  # else rates of density do not know them
    return numerics.model_copy(
        update={
            "viscosity_form": form,
            "shifting": shifts if numerics.shifting is None else numerics.shifting,
            "flux_coefficient": FLUXES[numerics.density_flux].coefficient if flux is None else flux,
            "artificial_viscosity": viscosity_of(form).artificial if alpha is None else alpha,
        }
    )


def _eos(config: SphConfig):
    eos = config.eos
    fastest = eos.max_velocity or speed_scale(config)
    if not fastest:  # nothing moves, or faults() has said that max_velocity is missing
        fastest = (eos.sound_speed or 1.0) / eos.sound_speed_factor
    background = eos.background_pressure
    if background is None:
        densest = max((fluid.density for fluid in config.fluid), default=0.0)
        covered = not any(open_sides(config, fluid) for fluid in config.fluid if not fluid.gas)
        background = HELD * densest * fastest**2 if covered and any(fluid.gas for fluid in config.fluid) else 0.0
    speeds = {"max_velocity": fastest, "sound_speed": eos.sound_speed or eos.sound_speed_factor * fastest}
    return eos.model_copy(update=speeds | {"background_pressure": background})
