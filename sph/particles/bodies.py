"""Rigid bodies that the fluid and gravity move: the same numbers on every rank, from exact sums of the forces."""

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case.config import AXES
from sph.kernels.groups import Moves
from sph.particles.tasks import Tasks, equal_parts
from sph.particles.wall_forces import WallForces
from sph.physics.timestep import Clock
from sph.setup.rigid import angle_of, gap, rotation, share, skew, solution, times, turning

PLACE, TURN, SPEED, SPIN = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
BOTH, FELT, COLUMNS = slice(7, 13), slice(13, 19), 19


class Bodies:
    """state[n, 19]: centre of mass m, rotation from the initial one (unit quaternion), velocity m/s, angular velocity
    1/s and the felt accelerations of both, in physical axes; in 2D what leaves the plane is 0. rates[n, 6]: the
    accelerations, by the forces.

    The pressure in a body follows its acceleration (Adami et al. 2012), and the force on it follows that pressure, as
    that of a layer of fluid of thickness dp would. What it feels approaches the rates by the share of the body in the
    mass of both in each step: all at once, light bodies would overshoot.
    """

    def __init__(self, clock: Clock, forces: WallForces, tasks: Tasks, motion: ModuleType) -> None:
        self.clock, self.forces, self.walls, self.tasks, self.motion = clock, forces, forces.walls, tasks, motion
        self.scene = scene = forces.walls.scene
        self.of: list[Any] = [wall for wall in scene.walls if wall.rigid]
        n, d = len(self.of), scene.dimensions
        self.state, self._old = np.zeros((2, n, COLUMNS))
        self.rates, self.share = np.zeros((n, 6)), np.zeros((n, 1))
        self.outer = [wall.near(*wall.bounds)[1] for wall in self.of]  # of the particles at t = 0, m
        self.free = np.ones((n, 6))  # 0 for motions that a body cannot make
        for k, wall in enumerate(self.of):
            body = wall.section.body
            self.state[k, PLACE], self.state[k, 3] = wall.rigid.centre, 1.0
            self.state[k, 7 : 7 + d], self.state[k, 13 - len(body.angular_velocity) : 13] = (
                body.velocity, body.angular_velocity)  # fmt: skip
            self.share[k] = share(wall, self.outer[k])
            names = [*AXES, *(f"r{axis}" for axis in AXES)]
            self.free[k] = [name not in body.held for name in names]
        self._spare = 0.0  # way in m that all bodies together may go before gaps are looked at
        number = np.full(len(scene.walls), -1)
        number[[wall.index for wall in self.of]] = np.arange(n)
        tasks.arena.group(moves=Moves)
        tasks.arena.set(
            body_of=number, body_centre=np.zeros((n, d)), body_way=np.zeros((n, d)), body_turn=np.zeros((n, d, d)),
            body_velocity=np.zeros((n, d)), body_spin=np.zeros((n, d, d)),
        )  # fmt: skip
        self._tell()

    def _matrix(self, m: NDArray[np.float64]) -> NDArray[np.float64]:
        """A matrix [3, 3] in storage axes, [d, d]."""
        axes = list(self.scene.axes)
        return m[np.ix_(axes, axes)]

    def _tell(self) -> None:
        """Let walls and kernels know where the bodies are and how fast."""
        scene, arena, axes = self.scene, self.tasks.arena, list(self.scene.axes)
        for k, (wall, state) in enumerate(zip(self.of, self.state)):
            d, turn = scene.dimensions, rotation(state[TURN])
            self.walls.displacement[wall.index] = (state[PLACE] - wall.rigid.centre)[:d]
            self.walls.velocity[wall.index] = state[SPEED][:d]
            self.walls.turns[wall.index] = wall.rigid.centre[:d], turn[:d, :d]
            arena["body_centre"][k] = (state[PLACE][:d] - scene.low)[axes]
            spin = skew(state[SPIN])
            self.walls.acceleration[wall.index] = state[13 : 13 + d]
            arena["wall_centre"][wall.index] = arena["body_centre"][k]
            arena["wall_twist"][wall.index] = self._matrix(skew(state[16:19]) + product(spin, spin))
            arena["body_velocity"][k], arena["body_spin"][k] = state[SPEED][axes], self._matrix(spin)

    def follow(self) -> None:
        """Give the particles the velocities of their bodies."""
        self._tell()
        self.tasks.arena["chunks"][:] = equal_parts(self.forces.storage.end, self.tasks.parts)  # some may be new
        self.tasks.each(self.motion.spin_bodies)

    def find_rates(self) -> None:
        """Find the accelerations by the last pair sums and gravity. Collective."""
        d, found = self.scene.dimensions, self.forces.now()
        for k, (wall, state, rate) in enumerate(zip(self.of, self.state, self.rates)):
            force, torque = found[wall.name]
            turn, spin = rotation(state[TURN]), state[SPIN]
            inertia = product(product(turn, wall.rigid.inertia), turn.T)
            rate[:d] = force / wall.rigid.mass + self.scene.gravity
            if d == 2:
                rate[5] = torque[2] / inertia[2, 2]
            else:
                rate[3:] = solution(inertia, torque - np.cross(spin, product(inertia, spin)))
            rate *= self.free[k]

    def keep(self) -> None:
        """Remember y^n."""
        self._old[:] = self.state

    def combine(self, old: float, now: float, new: float, with_new_velocity: bool) -> None:
        """y = old y^n + now y + new dt f(y), with the rates found last; quaternions get the length 1 again."""
        step, before = new * self.clock.time_step, self.state.copy()
        self.state[:, BOTH] = old * self._old[:, BOTH] + now * before[:, BOTH] + step * self.rates
        self._feel()
        by = self.state if with_new_velocity else before
        self.state[:, PLACE] = old * self._old[:, PLACE] + now * before[:, PLACE] + step * by[:, SPEED]
        for state, last, first, rate in zip(self.state, before, self._old, by):
            turn = old * first[TURN] + now * last[TURN]
            turn += step * 0.5 * times(np.array([0.0, *rate[SPIN]]), last[TURN])
            state[TURN] = turn / np.sqrt(np.sum(turn * turn))
        self._carry(before)

    def kick(self) -> None:
        """v = v + dt a."""
        self.state[:, BOTH] += self.clock.time_step * self.rates
        self._feel()
        self.follow()

    def _feel(self) -> None:
        self.state[:, FELT] += self.share * (self.rates - self.state[:, FELT])

    def drift(self) -> None:
        """x = x + dt v."""
        before = self.state.copy()
        self.state[:, PLACE] += self.clock.time_step * self.state[:, SPEED]
        for state in self.state:
            turn = times(turning(self.clock.time_step * state[SPIN]), state[TURN])
            state[TURN] = turn / np.sqrt(np.sum(turn * turn))
        self._carry(before)

    def _carry(self, before: NDArray[np.float64]) -> None:
        """Move the particles from where the bodies were to where they are."""
        arena, axes = self.tasks.arena, list(self.scene.axes)
        for k, (state, last) in enumerate(zip(self.state, before)):
            turn = product(rotation(state[TURN]), rotation(last[TURN]).T)
            arena["body_way"][k] = (state[PLACE] - last[PLACE])[axes]
            arena["body_turn"][k] = self._matrix(turn - np.eye(3))
        self.tasks.each(self.motion.move_bodies)
        self.follow()

    def look(self) -> None:
        """End the run where a body comes within a spacing of a wall or of another body: nothing keeps them apart."""
        ways = [np.sqrt(np.sum(s[SPEED] ** 2)) + np.sqrt(np.sum(s[SPIN] ** 2)) * self._radius(k)
                for k, s in enumerate(self.state)]  # fmt: skip
        self._spare -= 2 * float(max(ways)) * self.clock.time_step
        if self._spare > 0.0:
            return
        gap, body, wall = min(self.gaps(), default=(np.inf, "", ""))
        if gap < self.scene.spacing:
            text = f"{body} comes within a spacing of {wall} ({gap:.3g} m): bodies have no contact with walls or bodies"
            raise self.clock.diverged(text)
        self._spare = gap - self.scene.spacing

    def _radius(self, k: int) -> float:
        """Largest distance of a particle from the centre of a body, m."""
        d = self.scene.dimensions
        return float(np.sqrt(np.max(np.sum((self.outer[k] - self.of[k].rigid.centre[:d]) ** 2, axis=1))))

    def gaps(self) -> list[tuple[float, str, str]]:
        """Distance in m of every body from every wall and other body, with their names."""
        d, found = self.scene.dimensions, list[tuple[float, str, str]]()
        for k, (wall, state) in enumerate(zip(self.of, self.state)):
            r = self.outer[k] - wall.rigid.centre[:d]
            x = state[PLACE][:d] + np.einsum("ab,nb->na", rotation(state[TURN])[:d, :d], r)
            others = [other for other in self.scene.walls if other is not wall]
            found += [(gap(other, self.walls.at_rest(other, x)), wall.name, other.name) for other in others]
        return found

    def scalars(self) -> dict[str, float]:
        """Place, rotation, velocity and angular velocity of each body."""
        d, found = self.scene.dimensions, dict[str, float]()
        for wall, state in zip(self.of, self.state):
            turns = slice(0 if d == 3 else 2, 3)
            parts = {"position": state[PLACE][:d], "angle": angle_of(state[TURN])[turns], "velocity": state[SPEED][:d],
                     "spin": state[SPIN][turns]}  # fmt: skip
            for name, values in parts.items():
                axes = AXES[turns] if name in ("angle", "spin") else AXES
                found |= {f"{name}_{wall.name}_{axis}": float(value) for axis, value in zip(axes, values)}
        return found
