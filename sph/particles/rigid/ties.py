"""What acts on rigid bodies besides fluid and gravity: contacts, lines and hinges."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.kernels import contacts as kernel
from sph.kernels.contacts import Lines, Loads, Solids, Touches
from sph.particles.rigid.contacts import Contacts
from sph.particles.walls import Walls
from sph.physics.lines import tension
from sph.physics.timestep import Clock
from sph.setup.rigid.mass import inverse, rotation

ANGLE = 0.1  # of the phase of the fastest contact or line that a short step is: restitution within 1 %
DAMPED = 4.0  # short steps in the time in which a dashpot stops its body
Reals = NDArray[np.float64]


def vector(values: Sequence[float]) -> Reals:
    """Components as [3]."""
    return np.pad(np.array(values, float), (0, 3 - len(values)))


@dataclass(frozen=True)
class Hinge:
    """A point [3] about which a body turns, the direction [3] of its axis, the arm [3] of the centre of mass from the
    point at t = 0, m, and the inertia about the axis, kg m2 (2D: kg m).
    """

    point: Reals
    axis: Reals
    arm: Reals
    inertia: float

    def rates(self, turn: Reals, spin: Reals, force: Reals, torque: Reals) -> Reals:
        """Accelerations [6] of centre and spin by a force at the centre and a torque about it."""
        arm = product(rotation(turn), self.arm)
        whole = torque + np.cross(arm, force)
        change = self.axis * (float(np.sum(self.axis * whole)) / self.inertia)
        return np.concatenate([np.cross(change, arm) + np.cross(spin, np.cross(spin, arm)), change])

    def tied(self, turn: Reals, spin: Reals) -> Reals:
        """Place, rotation, velocity and spin [13] of the body nearest to this rotation and spin."""
        turn = np.array([turn[0], *(self.axis * float(np.sum(self.axis * turn[1:])))])
        turn /= np.sqrt(np.sum(turn * turn))
        spin = self.axis * float(np.sum(self.axis * spin))
        arm = product(rotation(turn), self.arm)
        return np.concatenate([self.point + arm, turn, np.cross(spin, arm), spin])


def hinge_of(wall: Any) -> Hinge | None:
    """The hinge of a body, if it has one."""
    given = wall.section.body.hinge
    if not given:
        return None
    point, axis = vector(given.point), np.array(given.axis or (0.0, 0.0, 1.0))
    axis /= np.sqrt(np.sum(axis * axis))
    arm = wall.rigid.centre - point
    about = wall.rigid.inertia + wall.rigid.mass * (np.sum(arm * arm) * np.eye(3) - np.outer(arm, arm))
    return Hinge(point, axis, arm, float(np.sum(axis * product(about, axis))))


class Ties:
    """Contacts and lines of the bodies `of` a scene in a step: see kernels.contacts for the arrays."""

    def __init__(self, clock: Clock, walls: Walls, of: list[Any]) -> None:
        self.clock, self.walls, self.of, self.scene = clock, walls, of, walls.scene
        self.hinges = [hinge_of(wall) for wall in of]
        self.rows = np.array([wall.index for wall in of])
        n, d = len(self.scene.walls), self.scene.dimensions
        origin = np.zeros((n, 3))
        for wall, hinge in zip(of, self.hinges):
            origin[wall.index] = hinge.point if hinge else wall.rigid.centre
        self.contacts = Contacts(clock, walls, origin)
        place, velocity, spin, momentum, light, pull, twist = np.zeros((7, n, 3))
        self.solids = Solids(place, np.zeros((n, 4)), velocity, spin, momentum, light, np.zeros((n, 3, 3)),
                             np.zeros(n, bool), pull, twist)  # fmt: skip
        self.solids.turn[:, 0] = 1.0
        self.moments = [self._answers(wall, hinge, d) for wall, hinge in zip(of, self.hinges)]
        self.lines = self._lines(origin)
        self._loads, self._before = (
            Loads(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 6))) for _ in range(2)
        )
        kernel.advance(0, 0.0, self.solids, nothing(), self.lines, self._loads, self._before)  # it compiles

    def _answers(self, wall: Any, hinge: Hinge | None, d: int) -> Reals:
        """Say what forces and torques give to a body; 1 for its free rotations [3], else 0."""
        k, held, solids = wall.index, wall.section.body.held, self.solids
        free = np.array([f"r{axis}" not in held and (d == 3 or axis == "z") for axis in "xyz"], float)
        if hinge:
            solids.inverse[k] = np.outer(hinge.axis, hinge.axis) / hinge.inertia
            return free
        solids.inverse_mass[k, :d] = [(axis not in held) / wall.rigid.mass for axis in "xyz"[:d]]
        solids.tumbles[k] = free.all()
        solids.inverse[k] = inverse(wall.rigid.inertia, free)
        return free

    def _lines(self, origin: Reals) -> Lines:
        """The moorings of all bodies."""
        body, arm, anchor, laws = list[int](), [], [], []
        for wall in self.of:
            for line in wall.section.body.mooring:
                at, to = vector(line.at), vector(line.anchor)
                length = float(np.sqrt(np.sum((to - at) ** 2))) if line.length is None else line.length
                body.append(wall.index)
                arm.append(at - origin[wall.index])
                anchor.append(to)
                laws.append((line.stiffness, length, line.damping, float(line.pushes)))
        rows = (np.array(values, float).reshape(len(body), n) for values, n in ((arm, 3), (anchor, 3), (laws, 4)))
        return Lines(np.array(body, np.int64), *rows)

    def _set(self, state: Reals, rates: Reals, loads: Reals) -> Reals:
        """Put the bodies and walls as they are into `solids`; the largest speed of a point of each in the step, m/s."""
        solids, d, (place, turn, velocity, spin) = self.solids, self.scene.dimensions, parts(state)
        solids.place[:, :d], solids.velocity[:, :d] = self.walls.displacement, self.walls.velocity
        for i, (wall, hinge) in enumerate(zip(self.of, self.hinges)):
            k = wall.index
            solids.turn[k], solids.spin[k] = turn[i], spin[i]
            solids.place[k], solids.velocity[k] = (hinge.point, 0.0) if hinge else (place[i], velocity[i])
            solids.pull[k], solids.twist[k] = 0.0 if hinge else rates[i, :3], rates[i, 3:]
            if hinge or d == 2:
                continue
            matrix = rotation(turn[i])
            inertia = product(product(matrix, wall.rigid.inertia), matrix.T)
            if solids.tumbles[k]:
                solids.momentum[k], solids.twist[k] = product(inertia, spin[i]), loads[i, 3:]
            else:
                solids.inverse[k] = inverse(inertia, self.moments[i])
        speeds, dt = np.sqrt(np.sum(solids.velocity**2, axis=1)), self.clock.time_step
        far = self.contacts.radius[self.rows]
        turns = np.sqrt(np.sum(spin**2, axis=1)) + dt * np.sqrt(np.sum(rates[:, 3:] ** 2, axis=1))
        speeds[self.rows] += turns * far + dt * np.sqrt(np.sum(solids.pull[self.rows] ** 2, axis=1))
        return speeds

    def advance(self, state: Reals, rates: Reals, loads: Reals) -> tuple[Reals, Reals] | None:
        """Place, rotation, velocity and spin [bodies, 13] at the end of the step, and the impulses [bodies, 6] of
        contacts and of contacts and lines, N s; None if there are neither.
        """
        touches = self.contacts.find(self.solids, self._set(state, rates, loads))
        if touches is None and not len(self.lines.body):
            return None
        touches, dt = touches or nothing(), self.clock.time_step
        steps = self._steps(touches)
        self._loads.impulse[:] = 0.0
        kernel.advance(steps, dt / steps, self.solids, touches, self.lines, self._loads, self._before)
        solids, found = self.solids, state[:, :13].copy()
        for i, (k, hinge) in enumerate(zip(self.rows, self.hinges)):
            ends = solids.turn[k], solids.spin[k]
            found[i] = hinge.tied(*ends) if hinge else np.concatenate(
                [solids.place[k], ends[0], solids.velocity[k], ends[1]])  # fmt: skip
        return found, self._loads.impulse[self.rows]

    def _steps(self, touches: Touches) -> int:
        """Short steps in one of the fluid: each a small part of the fastest swing of all contacts and lines at once."""
        n = len(self.scene.walls)
        pairs = np.repeat(np.arange(len(touches.laws)), np.diff(touches.cuts))
        square, rate, damping = np.zeros(n), np.zeros(n), 0.0
        for side, arm in ((touches.first, touches.arm), (touches.second, touches.foot)):
            np.add.at(square, side, touches.laws[pairs, 0] * self._lightness(side, arm))
            damping = max(damping, float(touches.laws[:, 1].max(initial=0.0)))
        light = self._lightness(self.lines.body, self.lines.arm)
        np.add.at(square, self.lines.body, self.lines.laws[:, 0] * light)
        np.add.at(rate, self.lines.body, self.lines.laws[:, 2] * light)
        swing = np.sqrt(2.0 * square.max()) * (1.0 + damping) / ANGLE
        return max(1, int(np.ceil(self.clock.time_step * (swing + DAMPED * rate.max()))))

    def _lightness(self, of: NDArray[np.int64], arm: Reals) -> Reals:
        """The most that 1 / mass is for forces at arms [n, 3] on solids [n]."""
        turning = np.einsum("nkk->n", self.solids.inverse)
        return self.solids.inverse_mass.max(axis=1)[of] + np.sum(arm * arm, axis=1) * turning[of]

    def tensions(self, k: int, state: Reals) -> list[float]:
        """Forces of the lines of the k-th body now, N."""
        found, (place, turn, velocity, spin) = [], parts(state)
        for m in np.flatnonzero(self.lines.body == self.rows[k]):
            arm = product(rotation(turn), self.lines.arm[m])
            at = self.hinges[k]
            to = self.lines.anchor[m] - (at.point if at else place) - arm
            speed, long = (0.0 if at else velocity) + np.cross(spin, arm), float(np.sqrt(np.sum(to * to)))
            growth = -float(np.sum(to * speed)) / long if long else 0.0
            found.append(float(tension(long, growth, *self.lines.laws[m].tolist())))
        return found


def parts(state: Reals) -> tuple[Reals, Reals, Reals, Reals]:
    """Place, rotation, velocity and spin of states [..., 13 and more]."""
    return state[..., 0:3], state[..., 3:7], state[..., 7:10], state[..., 10:13]


def nothing() -> Touches:
    """No contacts."""
    none, rows = np.zeros(0, np.int64), np.zeros((0, 3))
    return Touches(none, none, rows, rows, rows, rows, np.zeros(0), rows, np.zeros(1, np.int64), rows)
