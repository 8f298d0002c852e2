"""Small scenes of grains for the tests."""

import hashlib

import numpy as np

from hpcpic.core.physics.contact_law import ContactLaw
from hpcpic.core.simd.compile import njit  # noqa: F401  (the folder of compiled code, before numba is imported)
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.space.rng import uniforms
from hpcpic.core.tasks.graph import Pool
from lbmdem.grains.dem import Dem
from lbmdem.physics.plane_walls import PlaneWall

STIFFNESS, RADIUS, DENSITY = 1.0e4, 0.05, 2000.0


def grains(x, v=0.0, omega=0.0, radius=RADIUS, fixed=False, density=DENSITY):
    """Columns of spheres or discs at x[n, d]."""
    x = np.atleast_2d(np.asarray(x, float))
    n, d = x.shape
    radius = np.broadcast_to(np.asarray(radius, float), n).copy()
    mass = density * (np.pi * radius**2 if d == 2 else 4 / 3 * np.pi * radius**3)
    spins = np.zeros((n, 1 if d == 2 else 3))
    spins[:] = omega
    return {
        "x": x,
        "v": np.broadcast_to(np.asarray(v, float), (n, d)).copy(),
        "omega": spins,
        "radius": radius,
        "mass": mass,
        "inertia": (0.5 if d == 2 else 0.4) * mass * radius**2,
        "fixed": np.broadcast_to(np.asarray(fixed), n).copy(),
    }


def box(world, lengths, periodic=None, rows=12):
    """Domain of lengths and periodic axes in physical order; `rows` slabs can be cut."""
    d = len(lengths)
    periodic = periodic or (True,) * d
    points = (rows, *(4,) * (d - 1))
    return Domain(tuple(lengths[::-1]), points, tuple(periodic[::-1]), even_cuts(rows, world.size))


def dem(world, columns, law, lengths, *, periodic=None, walls=(), gravity=(), threads=1, pool=None, own=()):
    return Dem(world, pool or Pool(threads), box(world, lengths, periodic), columns, law, walls, gravity, own=own)


def by_id(scene, values):
    """Values of own grains of a run on one rank, in the order of ids."""
    return values[: scene.grains.n][np.argsort(scene.grains.columns["id"])]


def cloud(n, d, lengths, *, seed=3, speed=0.5, spread=0.3):
    """n grains at random without much overlap (on a jittered lattice), with random velocities and spins."""
    ids = np.arange(n)
    side = int(np.ceil(n ** (1 / d) - 1e-9))
    places = np.stack([ids // side**k % side for k in range(d)], 1) + 0.5
    u = uniforms(seed, 0, ids, 4 * d + 1)
    x = (places + spread * (u[:, :d] - 0.5)) * (np.asarray(lengths) / side)
    radius = RADIUS * (0.7 + 0.3 * u[:, -1])
    columns = grains(x, radius=radius)
    columns["v"][:] = speed * (2 * u[:, d : 2 * d] - 1)
    columns["omega"][:] = 5.0 * (2 * u[:, 2 * d : 2 * d + columns["omega"].shape[1]] - 1)
    return columns


LAW = ContactLaw(STIFFNESS, damping=0.2, friction=0.4, viscosity=10.0)
HISTORY = ContactLaw(STIFFNESS, damping=0.2, friction=0.4, viscosity=2.0, shear=0.8 * STIFFNESS)
FLOOR = PlaneWall((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


class Saved:
    """A state in memory, read back by rows as a checkpoint is. Collective."""

    def __init__(self, scene):
        self.time, self._arrays = scene.time, {}
        for name, shard in scene.state().items():
            whole = scene.world.gather_rows(shard.local)
            content = scene.world.bcast(None if whole is None else whole.tobytes())
            self._arrays[name] = np.frombuffer(content, shard.local.dtype).reshape(shard.total, *shard.local.shape[1:])

    def read(self, name, lo, hi):
        return self._arrays[name][lo:hi]

    def __getitem__(self, name):
        return self._arrays[f"grains/{name}"]

    @property
    def digest(self):
        return hashlib.sha256(b"".join(name.encode() + a.tobytes() for name, a in self._arrays.items())).hexdigest()
