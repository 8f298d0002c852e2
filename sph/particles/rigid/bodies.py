"""Rigid bodies that the fluid and gravity move: the same numbers on every rank, from exact sums of the forces."""

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case.config import AXES
from sph.kernels.groups import Moves
from sph.particles.rigid.ties import Ties
from sph.particles.tasks import Tasks, equal_parts
from sph.particles.wall_forces import WallForces
from sph.physics.timestep import Clock
from sph.setup.rigid.mass import angle_of, inverse, rotation, share, skew, times, turning

PLACE, TURN, SPEED, SPIN = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
BOTH, FELT, COLUMNS = slice(7, 13), slice(13, 19), 19
Reals = NDArray[np.float64]


class Bodies:
    """state[n, 19]: centre of mass m, rotation from the initial one (unit quaternion), velocity m/s, angular velocity
    1/s and the felt accelerations of both, in physical axes; in 2D what leaves the plane is 0. rates[n, 6]: the
    accelerations, by the forces of the fluid and gravity; pushes[n, 6]: those that contacts and lines add in this step.
    ledger[n, 6]: impulse of contacts on each so far, N s, and force of its hinge on it in the last step, N.

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
        self._square = np.ix_(list(scene.axes), list(scene.axes))
        self.ties = Ties(clock, forces.walls, self.of)
        self.pushes, self.ledger = np.zeros((2, n, 6))
        self.loads = np.zeros((n, 6))  # force N and torque N m of the fluid at the last rates
        self._ahead: Reals | None = None  # at the end of a step with contacts or lines; no numbers where nothing pushes
        self._begin, self.found = self.state, dict[str, Any]()
        number = np.full(len(scene.walls), -1)
        number[[wall.index for wall in self.of]] = np.arange(n)
        tasks.arena.group(moves=Moves)
        tasks.arena.set(
            body_of=number, body_centre=np.zeros((n, d)), body_way=np.zeros((n, d)), body_turn=np.zeros((n, d, d)),
            body_velocity=np.zeros((n, d)), body_spin=np.zeros((n, d, d)),
        )  # fmt: skip
        self._tie()
        self._tell()

    def _matrix(self, m: NDArray[np.float64]) -> NDArray[np.float64]:
        """A matrix [3, 3] in storage axes, [d, d]."""
        return m[self._square]

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
            self.walls.spin[wall.index] = state[SPIN]
            self.walls.acceleration[wall.index] = state[13 : 13 + d]
            arena["wall_centre"][wall.index] = arena["body_centre"][k]
            arena["wall_twist"][wall.index] = self._matrix(skew(state[16:19]) + product(spin, spin))
            arena["body_velocity"][k] = state[SPEED][axes]
            arena["body_spin"][k] = arena["wall_spin"][wall.index] = self._matrix(spin)

    def follow(self) -> None:
        """Give the particles the velocities of their bodies."""
        self.tasks.arena["chunks"][:] = equal_parts(self.forces.storage.end, self.tasks.parts)  # some may be new
        self.tasks.each(self.motion.spin_bodies)

    def find_rates(self) -> None:
        """Find the accelerations by the last pair sums and gravity. Collective."""
        d, found = self.scene.dimensions, self.forces.now()
        self.found = found
        for k, (wall, state, rate) in enumerate(zip(self.of, self.state, self.rates)):
            force, torque = found[wall.name]
            self.loads[k, :d], self.loads[k, 3:] = force, torque
            if hinge := self.ties.hinges[k]:
                weight = np.pad(wall.rigid.mass * self.scene.gravity, (0, 3 - d))
                rate[:] = hinge.rates(state[TURN], state[SPIN], self.loads[k, :3] + weight, torque)
                continue
            turn, spin = rotation(state[TURN]), state[SPIN]
            inertia = product(product(turn, wall.rigid.inertia), turn.T)
            rate[:d] = force / wall.rigid.mass + self.scene.gravity
            if d == 2:
                rate[5] = torque[2] / inertia[2, 2]
            else:
                gyration = np.cross(spin, product(inertia, spin))
                rate[3:] = product(inverse(inertia, self.free[k, 3:]), torque - gyration)
            rate *= self.free[k]

    def meet(self) -> None:
        """Find what contacts and lines do in the step that is about to be done, by short steps of their own, as the
        rates are.
        """
        self._begin, self._ahead, self.pushes[:] = self.state.copy(), None, 0.0
        dt, ends = self.clock.time_step, self.ties.advance(self.state, self.rates, self.loads)
        if ends is None:
            return
        places, impulses = ends
        pushed = np.any(impulses != 0.0, axis=1)
        self.pushes[pushed] = ((places[:, BOTH] - self.state[:, BOTH]) / dt - self.rates)[pushed]
        self.ledger[:, :3] += impulses[:, :3]
        self.ledger[:, 3:] = -impulses[:, 3:] / dt  # see `settle`
        self._ahead = np.where(pushed[:, None], places, np.nan)

    def settle(self) -> None:
        """Put bodies that touched or hang on lines where their short steps have led, at the end of a step."""
        if self._ahead is not None:
            before, pushed = self.state.copy(), np.isfinite(self._ahead[:, 0])
            self.state[pushed, :7] = self._ahead[pushed, :7]
            self._tie()
            self._carry(before)
        else:
            self.ledger[:, 3:] = 0.0
        for k, hinge in enumerate(self.ties.hinges):
            if hinge:
                d, mass = self.scene.dimensions, self.of[k].rigid.mass
                gained = mass * (self.state[k, SPEED] - self._begin[k, SPEED]) / self.clock.time_step
                self.ledger[k, 3:] += gained - self.loads[k, :3]
                self.ledger[k, 3 : 3 + d] -= mass * self.scene.gravity
            else:
                self.ledger[k, 3:] = 0.0

    def _tie(self) -> None:
        """Bodies on hinges are where their angles say, and move as they turn: nothing drifts."""
        for state, hinge in zip(self.state, self.ties.hinges):
            if hinge:
                state[:13] = hinge.tied(state[TURN], state[SPIN])

    def kept(self) -> dict[str, NDArray]:
        """What a checkpoint needs besides `state`, where there is any: sums of contacts and what is near others."""
        contacts = self.ties.contacts
        found: dict[str, NDArray] = {"ties/ledger": self.ledger} if self.ledger.any() else {}
        if len(contacts.keys):
            found |= {"ties/springs": contacts.springs, "ties/touching": contacts.keys, "ties/film": contacts.film}
        return found

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Take the arrays of a checkpoint."""
        contacts, none = self.ties.contacts, np.zeros((0, 3))
        self.state[:], self.ledger[:] = arrays["bodies"], arrays.get("ties/ledger", 0.0)
        keys = arrays.get("ties/touching", none[:, 0].astype(np.int64))
        contacts.take(keys, arrays.get("ties/springs", none), arrays.get("ties/film", np.zeros(len(keys))))
        contacts.forget()
        self._tell()

    def keep(self) -> None:
        """Remember y^n."""
        self._old[:] = self.state

    def combine(self, old: float, now: float, new: float, with_new_velocity: bool) -> None:
        """y = old y^n + now y + new dt f(y), with the rates found last; quaternions get the length 1 again."""
        step, before = new * self.clock.time_step, self.state.copy()
        self.state[:, BOTH] = old * self._old[:, BOTH] + now * before[:, BOTH] + step * (self.rates + self.pushes)
        self._feel()
        by = self.state if with_new_velocity else before
        self.state[:, PLACE] = old * self._old[:, PLACE] + now * before[:, PLACE] + step * by[:, SPEED]
        for state, last, first, rate in zip(self.state, before, self._old, by):
            turn = old * first[TURN] + now * last[TURN]
            turn += step * 0.5 * times(np.array([0.0, *rate[SPIN]]), last[TURN])
            state[TURN] = turn / np.sqrt(np.sum(turn * turn))
        self._tie()
        self._carry(before)

    def kick(self) -> None:
        """v = v + dt a."""
        self.state[:, BOTH] += self.clock.time_step * (self.rates + self.pushes)
        self._tie()
        self._feel()
        self._tell()
        self.follow()

    def _feel(self) -> None:
        self.state[:, FELT] += self.share * (self.rates + self.pushes - self.state[:, FELT])

    def drift(self) -> None:
        """x = x + dt v."""
        before = self.state.copy()
        self.state[:, PLACE] += self.clock.time_step * self.state[:, SPEED]
        for state in self.state:
            turn = times(turning(self.clock.time_step * state[SPIN]), state[TURN])
            state[TURN] = turn / np.sqrt(np.sum(turn * turn))
        self._tie()
        self._carry(before)

    def _carry(self, before: NDArray[np.float64]) -> None:
        """Move the particles from where the bodies were to where they are."""
        arena, axes = self.tasks.arena, list(self.scene.axes)
        for k, (state, last) in enumerate(zip(self.state, before)):
            turn = product(rotation(state[TURN]), rotation(last[TURN]).T)
            arena["body_way"][k] = (state[PLACE] - last[PLACE])[axes]
            arena["body_turn"][k] = self._matrix(turn - np.eye(3))
        self.tasks.each(self.motion.move_bodies)
        self._tell()
        self.follow()

    def scalars(self) -> dict[str, float]:
        """Place, rotation, velocity and angular velocity of each body, and forces of what it touches and hangs on."""
        d, found = self.scene.dimensions, dict[str, float]()
        for k, (wall, state) in enumerate(zip(self.of, self.state)):
            turns = slice(0 if d == 3 else 2, 3)
            parts = {"position": state[PLACE][:d], "angle": angle_of(state[TURN])[turns], "velocity": state[SPEED][:d],
                     "spin": state[SPIN][turns]}  # fmt: skip
            for name, values in parts.items():
                axes = AXES[turns] if name in ("angle", "spin") else AXES
                found |= {f"{name}_{wall.name}_{axis}": float(value) for axis, value in zip(axes, values)}
            for name, values in (("contact", self.ledger[k, :d]), ("hinge", self.ledger[k, 3 : 3 + d])):
                found |= {f"{name}_{wall.name}_{axis}": float(value) for axis, value in zip(AXES, values)}
            found |= {f"mooring_{wall.name}_{i + 1}": force for i, force in enumerate(self.ties.tensions(k, state))}
        return found
