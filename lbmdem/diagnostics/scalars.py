"""Scalars of a run: sums over nodes and grains that are the same for any ranks, in SI units."""

import logging
import math

from numpy.typing import NDArray

from hpcpic.core.case.columns import joined
from hpcpic.core.case.gauge import gauge_columns
from hpcpic.core.comm.world import World
from hpcpic.core.run.gauges import Gauges
from hpcpic.core.space.domain import Domain
from lbmdem.case.config import AXES
from lbmdem.coupling.driven_grains import DrivenGrains
from lbmdem.coupling.immersed import Immersed
from lbmdem.diagnostics import snapshot
from lbmdem.diagnostics.fluid_scalars import FluidScalars
from lbmdem.diagnostics.sample import sample_ends, slice_edges
from lbmdem.fluid.drive import Drive
from lbmdem.fluid.fluid import Fluid
from lbmdem.grains import contact_network
from lbmdem.kernels.layout import FLUID
from lbmdem.setup.scene import GrainTable, Scene

log = logging.getLogger("hpcpic.lbmdem")

WARN_SPEED = 0.3  # nodes per step
WARN_DRIFT = 1e-3  # change of the mean density of a closed fluid
WARN_FALLBACKS = 0.01  # share of links that do not follow their rule
ENOUGH_OVERLAP = 0.01  # over the diameter: as linear contacts are meant


def stiffer(overlap: float, stiffness: float) -> str:
    """What makes this overlap over the diameter small enough."""
    times = overlap / ENOUGH_OVERLAP
    return (
        f"contact.normal_stiffness = {times * stiffness:.2g} gives 1 % where a load or a flow presses them together, "
        f"{times**2 * stiffness:.2g} where they strike"
    )


class Diagnostics:
    """The scalars of a simulation with their `units`, and what the guard looks at.

    heights: of the rows of this rank, m. fluid: its part. overlap: greatest one over diameter, at the last look;
    expected_overlap: what is more is warned of.
    """

    def __init__(
        self,
        scene: Scene,
        world: World,
        domain: Domain,
        table: GrainTable,
        heights: NDArray,
        fluid: Fluid | None,
        drive: Drive | None,
        immersed: Immersed | None,
        grains: DrivenGrains | None,
    ) -> None:
        self._scene, self._world, self._table = scene, world, table
        self._immersed, self._grains = immersed, grains
        self._axes = AXES[: scene.dimensions]
        self._bodies = [*scene.set_names, *(obstacle.name for obstacle in scene.config.obstacle)]
        planes = [obstacle.name for obstacle in scene.config.obstacle if obstacle.shape.plane is not None]
        # planes of obstacles are the last walls that grains meet (setup.box_walls)
        first = len(grains.dem.walls) - len(planes) if grains else 0
        self._met = {name: first + k for k, name in enumerate(planes)} if grains else {}
        self._flow = fluid
        self._warned: set[str] = set()
        self.overlap = 0.0
        self.expected_overlap = ENOUGH_OVERLAP
        ends = sample_ends(table.x, table.radius, scene.config.domain.size[-1])
        n_slices = scene.config.output.stress_slices if grains else 0
        self.slices = slice_edges(*ends, 2.0 * float(table.radius.max(initial=0.0)), n_slices)
        self.fluid = FluidScalars(scene, world, fluid, drive, immersed, ends, heights) if fluid and drive else None
        self.gauges = Gauges(scene.config.gauge, domain, world)
        self.units = joined([("the scene", self._units()), *gauge_columns(scene.config.gauge, scene.config.fields)])

    def go_on(self, before: "Diagnostics") -> None:
        """Know what these have seen of the same run."""
        self._warned, self.overlap = before._warned, before.overlap
        if self.fluid and before.fluid:
            self.fluid.go_on(before.fluid)
        if self._grains and before._grains:
            self._grains.least_film, self._grains.worst_film = before._grains.least_film, before._grains.worst_film

    def _units(self) -> dict[str, str]:
        per = "" if self._scene.dimensions == 3 else "/m"  # two-dimensional quantities are per metre of depth
        units = dict(self.fluid.units) if self.fluid else {}
        units |= {"link_fallbacks": ""} if self._immersed else {}
        if self.fluid:
            units |= {f"force_{name}_{axis}": f"N{per}" for name in self._bodies for axis in self._axes}
        units |= {f"contact_{name}_{axis}": f"N{per}" for name in self._met for axis in self._axes}
        if self._grains:
            units |= {"contact_count": "", "energy_kinetic_grains": f"J{per}", "overlap": ""}
            units |= {"least_film": ""} if self._grains.has_films else {}
        slices = range(1, len(self.slices))
        units |= {f"stress_{2 * self._axes[-1]}_{k}": "Pa" for k in slices}
        return units | {f"pressure_{k}": "Pa" for k in slices if self.fluid}

    def scalars(self, step: int) -> dict[str, float]:
        """Collective. Momentum and velocity are those at full steps, with half of the body force."""
        values = self._of_fluid(self.fluid, step) if self.fluid else {}
        values |= self._of_solids(self._immersed, step) if self._immersed else {}
        values |= self._of_grains(self._grains, step) if self._grains else {}
        values |= self._of_gauges() if self.gauges else {}
        return {name: values[name] for name in self.units}

    def _warn_once(self, kind: str, wrong: bool, text: str, step: int) -> None:
        if wrong and kind not in self._warned:
            self._warned.add(kind)
            if self._world.rank == 0:
                log.warning("step %d: %s", step, text)

    def _of_fluid(self, fluid: FluidScalars, step: int) -> dict[str, float]:
        values = fluid.scalars(step, self.slices)
        text = f"the fluid moves by {fluid.fastest:.2f} nodes in a step (limit 0.4)"
        self._warn_once("speed", fluid.fastest > WARN_SPEED, text, step)
        text = f"the mean density of the fluid has changed by {fluid.drift:.1e}{self.way_to_keep_mass()}"
        self._warn_once("mass", abs(fluid.drift) > WARN_DRIFT, text, step)
        return values

    def way_to_keep_mass(self) -> str:
        """What gives back the mass that links of curved solids, also of those that stay, and covered nodes take."""
        keeps = self._scene.config.coupling.keeps_mass  # then what is lost is something else
        return "" if keeps or self._immersed is None else ': coupling.refill = "mass-conserving" gives it back'

    @property
    def grains_stay(self) -> bool:
        """Whether there are grains, of which none moves."""
        return self._grains is None and bool(self._scene.config.grains)

    def _of_gauges(self) -> dict[str, float]:
        """Gauges read the nodes of the fluid alone."""
        assert self._flow is not None
        return self.gauges.values(snapshot.fields(self._scene, self._flow), self._flow.solid.inner == FLUID)

    def _of_solids(self, immersed: Immersed, step: int) -> dict[str, float]:
        """Share of links without their rule, and the force on every set of grains and every obstacle.

        It is the momentum that the nodes of the fluid lose; a body force a acts on the place of a solid of volume V
        by density V a besides (Scene.constant_force).
        """
        counts, table, unit = immersed.counts(), self._table, self._scene.units.force
        share = counts["fallbacks"] / max(1, counts["links"])
        text = f"{share:.1%} of the links have no room for their wall rule, and follow a simpler one: in corners, at "
        text += "contacts and in narrow gaps of solids. Flows were off by 1 % with 7 % of the links (a duct with sharp "
        text += "corners, 20 nodes wide), 3 % with 21 % (spheres of 34 nodes that touch), 45 % with 52 % (of 7), and "
        text += "up to 70 % with 12 to 23 % in gaps of 1.5 nodes between discs; a finer spacing cures it"
        self._warn_once("links", share > WARN_FALLBACKS, text, step)
        force, walls = immersed.all_forces(len(table))[0] * unit, immersed.wall_forces()[0] * unit
        of_sets = [force[table.set == k].sum(axis=0) for k in range(len(self._scene.set_names))]
        values = {"link_fallbacks": share}
        for name, of_body in zip(self._bodies, (*of_sets, *walls)):
            values |= {f"force_{name}_{axis}": float(f) for axis, f in zip(self._axes, of_body)}
        return values

    def _of_grains(self, grains: DrivenGrains, step: int) -> dict[str, float]:
        """Contacts, what they and films press on obstacles, kinetic energy, and stresses in the control slices."""
        dem = grains.dem
        self.overlap = contact_network.greatest_overlap(dem)
        values = {"contact_count": float(contact_network.contact_count(dem)), "overlap": self.overlap}
        values["energy_kinetic_grains"] = contact_network.kinetic_energy(dem)
        if (times := self.overlap / self.expected_overlap) > 1.0:  # told again at twice as much
            text = f"grains overlap by {self.overlap:.1%} of a diameter, which check did not tell: "
            text += stiffer(self.overlap, dem.law.stiffness)
            self._warn_once(f"overlap {int(math.log2(times))}", True, text, step)
        for name, wall in self._met.items():
            force = contact_network.wall_force(dem, wall)
            values |= {f"contact_{name}_{axis}": float(f) for axis, f in zip(self._axes, force)}
        if grains.has_films:
            values["least_film"] = grains.least_film
            text = f"a film had {grains.worst_film:.1%} of its resistance, all that is stable with so few substeps"
            self._warn_once("films", grains.worst_film < 1.0, text, step)
        if len(self.slices) > 1:
            stress = contact_network.stress(dem, self.slices)[:, -1, -1]
            values |= {f"stress_{2 * self._axes[-1]}_{k + 1}": float(s) for k, s in enumerate(stress)}
        return values
