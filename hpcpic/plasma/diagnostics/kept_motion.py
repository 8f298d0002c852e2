"""What the motion of all particles keeps, whatever they do to each other: one that jumps tells damaged memory.

Forces between particles add up to nothing, so a step of the Boris mover changes the sum of momenta by the rotation
alone: with t of each species (physics.boris), sum m v+ - sum m v- = sum m (v+ + v-) x t. As v+ + v- is the sum of the
velocities before and after the step, and these are (x^(n+1) - x^(n-1)) / dt together,

    P = sum m v^(n-1/2)  changes by  sum (2 m / dt) (X x t),  X the way of (x^n + x^(n-1)) / 2,

over any number of steps, to rounding. Along B nothing turns it: P stays, and sum m X is P times the time. With
exact_phase impulses across B are multiplied by a factor of each species, and add up to nothing where it is one factor;
a uniform field then pushes not quite along itself, but where it lies along or across B.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.plasma.diagnostics.energy_watch import MIN_PARTICLES
from hpcpic.plasma.setup.scene import Scene
from hpcpic.plasma.sizes import EDGE, PLACE_BITS

PARALLEL = 1e-12  # sines of smaller angles are rounding
Places = list[list[int]]


class Motion(NamedTuple):
    """At a step: places[species][axis], sums of (x^n + x^(n-1)) / 2 in 2^-40 of a cell, as if the box had no ends;
    momentum[3] = P in kg m/s.
    """

    step: int
    places: Places
    momentum: NDArray[np.float64]


class Law(NamedTuple):
    """P along[3] changes by the sum of turned[species, axis] m X / dt; `straight`: by nothing, and X is known there."""

    along: NDArray[np.float64]
    turned: NDArray[np.float64]
    straight: bool


class KeptMotion:
    """The motion as it is seen now and then.

    charge_parts: into how many parts a charge is divided, to which forces are opposite. A step adds to the momentum of
    a particle at most wp dt <= 2 times what its energy stands for. Its place in a tile is rounded in each, and what
    is summed of it at a look: of particles that lie and move alike in the same direction.
    """

    def __init__(self, scene: Scene, charge_parts: float, real: np.dtype) -> None:
        self.dimensions, species, spacing = scene.dimensions, scene.species, np.array(scene.spacing)
        self.mass = float(sum(one.n * one.m for one in species))
        self.per_part = 2.0**-PLACE_BITS * np.outer([one.m for one in species], spacing) / scene.time_step
        self.laws = laws(scene) if scene.n_particles >= MIN_PARTICLES else []
        self.rounding = 4.0 / charge_parts * max((one.impulse_across(1.0) for one in species), default=1.0)
        self.seconds_per_mass = scene.time_step / self.mass if self.mass else 0.0
        self.per_cell = self.mass * float(spacing.max()) / abs(scene.time_step)
        self.edge_rounding = EDGE[self.dimensions] * float(np.finfo(real).eps)  # of a place in its tile, cells
        self.kept: Motion | None = None
        self.trouble: str | None = None

    def see(self, now: Motion, energy: float) -> None:
        """The motion at a step, with the energy of all in J."""
        last, self.kept = self.kept, now
        if last is None or not self.laws or not math.isfinite(energy):
            return
        steps = abs(now.step - last.step)
        gone = np.array(now.places, object) - np.array(last.places, object)  # whole numbers of any size
        way = self.per_part * gone.astype(np.float64)
        kicks = (steps + 1) * self.rounding * math.sqrt(2.0 * self.mass * energy)
        places = ((steps + 1) * self.edge_rounding + 2.0 * 2.0**-PLACE_BITS) * self.per_cell
        for law in self.laws:
            turned = float(np.abs(law.turned).max(initial=0.0))
            changed = law.along @ (now.momentum - last.momentum) - np.sum(law.turned * way)
            jumps = {"momentum": (changed, kicks + turned * places, 1.0, "kg m/s")}
            if law.straight:
                mean = 0.5 * law.along @ (now.momentum + last.momentum)
                moved = (law.along[: self.dimensions] @ way.sum(axis=0) - steps * mean) / max(steps, 1)
                metres = self.seconds_per_mass * max(steps, 1)
                jumps["mean position"] = (moved, kicks + places / max(steps, 1), metres, "m")
            for what, (jump, allowed, scale, unit) in jumps.items():
                if abs(jump) > allowed:
                    where = ", ".join(f"{one:g}" for one in law.along)
                    told = f"({where}) jumped between steps {last.step} and {now.step} (by {jump * scale:.3g} {unit})"
                    self.trouble = f"the {what} along {told}, which nothing in the scene can do: damaged memory"


def laws(scene: Scene) -> list[Law]:
    """Directions in which no work is done and turns are known: ways that the grid lacks (z, in 1D y) are not."""
    config, d, found = scene.config, scene.dimensions, list[Law]()
    if any(species.section.acceleration for species in scene.species):
        return found
    b, e = np.array(config.field.magnetic), np.array(config.field.electric)
    t = np.array([species.rotation[0] for species in scene.species]).reshape(-1, 3)
    tried = [*np.eye(3)[: scene.velocity_components], b, b * (1.0, 1.0, 0.0)]
    factors = {species.impulse_across(1.0) for species in scene.species if species.q}
    alike, uneven = len(factors) < 2, bool(factors - {1.0})
    for along in (vector / np.linalg.norm(vector) for vector in tried if vector.any()):
        turned = 2.0 * np.cross(t, along)
        turned[np.abs(turned) < PARALLEL * np.abs(t).max(initial=0.0)] = 0.0
        pushed = np.dot(e, along) or (uneven and np.dot(e, b) * np.dot(b, along))
        if turned[:, d:].any() or pushed or not (alike or not turned.any()):
            continue
        if not any(np.allclose(along, law.along) for law in found):
            found.append(Law(along, turned[:, :d], not turned.any() and not along[d:].any()))
    return found
