"""What the pair sums of a scene are made for, and the numbers and units that they compute with."""

import numpy as np
from numpy.typing import NDArray

from sph.case.config import SphConfig
from sph.kernels.groups import Scales
from sph.physics.fluxes import FLUXES
from sph.physics.integrators import INTEGRATORS
from sph.physics.liquids import liquids_of
from sph.physics.pair_spec import NUMBERS, UNIT, PairSpec
from sph.physics.smoothing import SMOOTHING, Smoothing
from sph.physics.terms import CORE
from sph.physics.viscosities import viscosity_of
from sph.physics.wall_rules import rule_of
from sph.physics.waves import cleary_constant
from sph.setup.scene import Scene

NARROW_HOLDS = 1.5  # h / dp up to which a jet of c0 / 10 gets a spacing deep into a wall in 3D, not through it
WIDE_CORE = 0.9  # in 3D where h is large, and with rigid bodies: between four particles of a wall too
BODY_CORE = 2.0  # with rigid bodies, which press on fluid: for jets of c0 / 3
SPACE_CORE = 0.07  # in 3D, strength times -F dp^5 at 0.8 dp: what comes with c0 / 10 turns round between four of a wall
CORE_MIDDLE = 0.8  # spacings: between four particles of a wall, half way into their cores
WET = 0.3  # of the fluid that still water has before a wall; around a disc it is 0.45 or more


def before_a_wall(smoothing: Smoothing, d: int, ratio: float) -> float:
    """The sum of V W over half of a lattice at a particle of a wall, a spacing off; ratio = h / dp."""
    reach = int(smoothing.support * ratio) + 1
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * d), axis=-1).reshape(-1, d)
    r = np.sqrt(np.sum(np.square(steps[steps[:, 0] > 0]), axis=1)) / ratio
    return float(np.sum(smoothing.value(r[r < smoothing.support], d))) / ratio**d


def core_of(smoothing: Smoothing, d: int, ratio: float, rigid: bool) -> tuple[float, float]:
    """Width in spacings and strength in rho0 c0^2 of the stiff cores of walls (`terms.kept_out`); ratio = h / dp. Wide
    ones hold jets in 3D where narrow ones let them through, which push the less the larger h is; they push with the
    same force whatever h. They take energy from thin sheets that strike the wall, so the others stay where they hold.
    """
    if rigid:
        return WIDE_CORE, BODY_CORE
    if d == 2 or ratio <= NARROW_HOLDS:
        return CORE, 1.0
    return WIDE_CORE, SPACE_CORE * ratio**5 / -float(smoothing.gradient(CORE_MIDDLE / ratio, d))


def pair_spec_of(config: SphConfig, others: bool, films: bool = False) -> PairSpec:
    """What the kernels of a case are made for. others: there are walls, or images of the fluid; films: solids that stay
    press on others across a film.
    """
    numerics, form = config.numerics, viscosity_of(config.numerics.viscosity_form)
    rules = [rule_of(wall.type) for wall in config.wall]
    liquids = liquids_of(config)
    viscous = liquids.viscosity > 0 and form.physical
    bodies = [rule for rule, wall in zip(rules, config.wall) if wall.body]
    sticking = viscous and form.laplacian and not all(rule.slips for rule in bodies)
    return PairSpec(
        config.dimensions,
        numerics.kernel,
        flux=FLUXES[numerics.density_flux if numerics.flux_coefficient else "none"],
        viscosity=form if viscous else viscosity_of("none"),
        artificial=bool(numerics.artificial_viscosity),
        single=numerics.precision == "single",
        walls=others,
        without_volume=all(rule.repulsive for rule in rules),
        tensile=numerics.tensile_correction > 0,
        shifting=bool(numerics.shifting),
        corrected=numerics.gradient_correction,
        by_mass=numerics.continuity == "masses",
        moments=config.output.moments,
        densities=liquids.densities,
        viscosities=liquids.viscosities and viscous,
        gases=liquids.gases,
        split=INTEGRATORS[config.simulation.integrator].split,
        repulsive=any(rule.repulsive for rule in rules),
        extrapolated=any(rule.extrapolated for rule in rules),
        accelerated=any(
            rule.extrapolated and (wall.body or (wall.motion is not None and any(wall.motion.amplitude)))
            for rule, wall in zip(rules, config.wall)
        ),
        turning=bool(bodies),
        driven=any(fluid.acceleration for fluid in config.fluid),
        films=films or any(rule.extrapolated and wall.body for rule, wall in zip(rules, config.wall)),
        edges=any(rule.has_edges(bool(wall.body), liquids) for rule, wall in zip(rules, config.wall)),
        sticking=sticking,
        wetted=sticking and form.along_velocity,
    )


class PairNumbers:
    """Arrays of a scene for kernels. Single precision has lengths in h UNIT, and units of c0, rho0 and rho0 h^d.

    numbers: see NUMBERS, with `half_step` for no step; half_steps: its value per s of a step; factors: what makes of
    sums a [m/s2] without gravity and body force, with 1 / m, and d rho / dt [kg/m3 s].
    """

    def __init__(self, scene: Scene, spec: PairSpec) -> None:
        self.scene, self.spec = scene, spec
        h, c, rho, d = scene.h, scene.c0, scene.rho0, scene.dimensions
        si = 1.0, 1.0, 1.0, 1.0
        length, speed, density, mass = (h * UNIT, c, rho, rho * h**d) if spec.single else si
        self.length, self.speed = length / h, speed / c  # the units of pair sums in those of the scene
        self.density, self.mass = density / rho, mass / (rho * h**d)
        self.sums = SMOOTHING[scene.kernel].factor(d) * self.mass * self.length
        self.half_steps = 0.5 * c / h * (self.speed / self.length)

    @property
    def scales(self) -> Scales:
        """What kernels.columns multiplies with."""
        scene = self.scene
        h, c, rho = scene.h, scene.c0, scene.rho0
        length, speed, sums = self.length, self.speed, self.sums
        return Scales(
            1 / h, 1 / c, 1 / rho, 1 / (rho * h**scene.dimensions), scene.eos.background / (rho * c * c),
            scene.viscosity / (rho * c * h), scene.config.numerics.tensile_correction, sums * length, sums * speed,
            sums, sums * length, h / (c * c) * length / self.density, h / c * length / speed,
            WET * before_a_wall(SMOOTHING[scene.kernel], scene.dimensions, h / scene.spacing) / self.of_moments[0],
        )  # fmt: skip

    @property
    def of_moments(self) -> list[float]:
        """What makes of the sums of (MP 12) and (MP 13) their moments, in units of h: of W, of W r, of W', of W' r."""
        weight = SMOOTHING[self.scene.kernel].norm[self.scene.dimensions] * self.mass
        return [weight, weight * self.length, self.sums, self.sums * self.length]

    @property
    def factors(self) -> NDArray[np.float64]:
        scene, sums = self.scene, self.sums
        h, c, rho = scene.h, scene.c0, scene.rho0
        forces = c * c / h * (sums * self.mass) * (rho * h**scene.dimensions)
        return np.array([forces, rho * c / h * (sums * self.density * self.speed)])

    @property
    def numbers(self) -> NDArray[np.float64]:
        scene, numerics, smoothing = self.scene, self.scene.config.numerics, SMOOTHING[self.scene.kernel]
        h, c, d, length, speed = scene.h, scene.c0, scene.dimensions, self.length, self.speed
        strength = (numerics.flux_coefficient or 0.0) * (length if self.spec.flux.upwind else 2.0)
        xi = cleary_constant(scene.kernel, d, numerics.smoothing) if self.spec.viscosity.calibrated else 1.0
        gravity = np.zeros(3)
        gravity[:d] = scene.gravity[list(scene.axes)] * (h / (c * c)) * (length / self.density)
        fall = np.zeros(3)
        fall[:d] = scene.acceleration[list(scene.axes)] * (h / (c * c)) * (length / self.density)
        size, core = core_of(smoothing, d, h / scene.spacing, any(wall.rigid for wall in scene.walls))
        numbers = {
            "artificial": -0.5 * (numerics.artificial_viscosity or 0.0) * (speed / length),
            "viscous": -2.0 * xi * scene.viscosity / (scene.rho0 * c * h) * (speed / length),
            "flux_strength": strength / (length * speed),
            "reach": h / scene.spacing,
            "core": core,
            "core_reach": h / scene.spacing * (core * CORE / size),
            "per_w": 1.0 / float(smoothing.w(np.float64(scene.spacing / h), 1.0)),
            "per_h": length,
            "eta2": 0.01 / (length * length),
            "density": 1.0 / self.density,
            "half_step": 0.0,
            "hundredth": 0.01 / (smoothing.factor(d) * self.mass * length),
        } | {f"gravity{axis}": gravity[k] for k, axis in enumerate("xyz")}
        numbers |= {f"fall{axis}": fall[k] for k, axis in enumerate("xyz")}
        return np.array([numbers[name] for name in NUMBERS])
