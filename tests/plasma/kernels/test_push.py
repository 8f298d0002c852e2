"""Laws of the particle kernels: vector = plain bits, exact charge, no particle lost at any speed, |v| kept."""

import numpy as np
import pytest

from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.space.domain import Domain
from hpcpic.plasma.diagnostics.scalars import moments
from hpcpic.plasma.particles.cloud import Cloud
from hpcpic.plasma.particles.push_spec import PushSpec
from hpcpic.plasma.physics.boris import rotation_vectors, shears, turn
from hpcpic.plasma.physics.shapes import SHAPES
from hpcpic.plasma.sizes import WHOLE_BITS

SPECS = [(2, 2, 0, "CIC"), (2, 2, 1, "CIC"), (2, 3, 2, "CIC"), (1, 1, 0, "CIC"), (1, 3, 2, "CIC"),
        (2, 2, 0, "NGP"), (1, 1, 0, "NGP"), (2, 2, 0, "TSC"), (1, 1, 0, "TSC"),
        (3, 3, 0, "CIC"), (3, 3, 2, "CIC"), (3, 3, 3, "CIC"), (2, 3, 3, "CIC"),
        (3, 3, 0, "NGP"), (3, 3, 0, "TSC")]  # fmt: skip
BY_DEFAULT = [(2, 2, 0, "CIC", np.float32), (2, 2, 1, "CIC", np.float64), (2, 3, 2, "CIC", np.float64),
       (1, 1, 0, "NGP", np.float32), (2, 2, 0, "TSC", np.float64)]  # fmt: skip
BOTH = [
    pytest.param(*spec, dtype, marks=[] if (*spec, dtype) in BY_DEFAULT else pytest.mark.validation)
    for spec in SPECS
    for dtype in (np.float64, np.float32)
]  # by default each shape, rotation and precision, in 1D and 2D: each of all modules takes 27 s to compile
COMPILED = {(2, "CIC"), (1, "NGP"), (2, "TSC"), (3, "CIC")}
BY_AXES_AND_SHAPE = [
    pytest.param(d, shape, marks=[] if (d, shape) in COMPILED else pytest.mark.validation)
    for d in (1, 2, 3)
    for shape in ("NGP", "CIC", "TSC")
]


def free(d, shape):
    """Without a field, in the precision that is compiled by default."""
    dtype = np.float64 if shape == "TSC" or d == 3 else np.float32
    return PushSpec(d, SHAPES[shape], d, 2 if (d, shape) == (3, "CIC") else 0, dtype, moments())


def linear(dtype, velocities=2, rotation=0):
    """CIC in 2D."""
    return PushSpec(2, SHAPES["CIC"], velocities, rotation, dtype, moments())


def cloud(pool, spec, points, *, blocks=1, n=4000, speed=0.3, plain=False, field=0.1, x=None):
    """Two species of opposite charge in a random field; two ranks' worth of nothing else."""
    rng = np.random.default_rng(1)
    d, (below, above) = spec.dimensions, spec.shape.ghosts
    shape = points[::-1]
    domain = Domain(tuple(map(float, shape)), shape, (True,) * d, (0, shape[0]))
    e = np.stack([np.pad(rng.standard_normal(shape) * field, [(below, above)] * d, mode="wrap") for _ in range(d)])
    room = np.zeros(e.size + 16)  # vectors may read beyond the end
    room[: e.size] = e.ravel()
    t = 0.1
    s = 2 * t / (1 + t * t)
    mover = np.array([[0.1, 0.1, 0, 0.1 if d == 3 else 0, *([t, -s] * 3), *[0.02] * 3, *[-0.5] * 3]] * 2)
    unit = 1 << WHOLE_BITS[np.dtype(spec.dtype).itemsize]
    charge = np.array([[0, unit], [0, -unit]], np.int64)
    e = room[: e.size].reshape(e.shape)
    made = Cloud(World.start(), pool, domain, spec, blocks=blocks, mover=mover, charge=charge, e=e, scale=1.0,
                 capacity=2 * n, plain=plain)  # fmt: skip
    for species in range(2):
        at = rng.random((n, d)) * points if x is None else np.broadcast_to(x, (n, d))
        made.place(species, at, rng.standard_normal((n, spec.velocities)) * speed, np.arange(n))
    made.deliver()
    made.deposit_all()
    return made


def everybody(made, species):
    """Numbers, tiles, components of a species."""
    chunks = [tuple(part.copy() for part in chunk) for chunk in made.export(species)]
    return tuple(np.concatenate(parts) for parts in zip(*chunks))


def bits(made):
    """Tiles and components in order of the numbers."""
    found = b""
    for species in range(2):
        numbers, tiles, components = everybody(made, species)
        order = np.argsort(numbers)
        assert np.array_equal(numbers[order], np.arange(len(numbers)))  # none lost, none doubled
        found += tiles[order].tobytes() + components[order].tobytes()
    return found


def advance(made, steps):
    for iteration in range(steps):
        made.push(iteration)
        made.deliver()


@pytest.mark.parametrize(("d", "v", "rotation", "shape", "dtype"), BOTH)
def test_vectors_give_the_bits_of_the_plain_kernels(pool, shape, d, v, rotation, dtype):
    points = {1: (600,), 2: (41, 37), 3: (19, 13, 10)}[d]
    spec = PushSpec(d, SHAPES[shape], v, rotation, dtype, moments())
    for n, speed in ((4000, 0.3), (4000, 40.0), (60, 5.0)):  # 60: so few that some tiles go without vectors
        fast, plain = (cloud(pool, spec, points, blocks=3, n=n, speed=speed, plain=plain) for plain in (False, True))
        for _ in range(3):
            advance(fast, 1)
            advance(plain, 1)
            assert bits(fast) == bits(plain)
            assert np.array_equal(fast.patches.values, plain.patches.values)


@pytest.mark.parametrize(("d", "shape"), BY_AXES_AND_SHAPE)
def test_charge_is_exact_and_blocks_do_not_show(pool, d, shape):
    spec = free(d, shape)
    grids = {1: [(300,), (1,)], 2: [(1, 5), (7, 8), (9, 1), (97, 101)], 3: [(1, 1, 5), (7, 8, 1), (17, 9, 23)]}
    for points in grids[d]:
        found = set()
        for blocks in (1, 4, 9):
            made = cloud(pool, spec, points, blocks=blocks, n=300, speed=40.0)
            made.arena["charge"][1] *= -1  # now both species add
            advance(made, 3)
            assert made.patches.values.sum() == 600 << WHOLE_BITS[np.dtype(spec.dtype).itemsize]
            found.add(bits(made))
        assert len(found) == 1, points


@pytest.mark.parametrize(("d", "shape"), BY_AXES_AND_SHAPE)
def test_patches_hold_the_charge_of_all_particles(pool, d, shape):
    """What push and deliver add up by the way is what a fresh deposit of everybody gives."""
    points = {1: (700,), 2: (40, 33), 3: (17, 13, 9)}[d]
    made = cloud(pool, free(d, shape), points, blocks=3, speed=5.0)
    advance(made, 2)
    by_the_way = made.patches.values.copy()
    made.deposit_all()
    assert np.array_equal(made.patches.values, by_the_way)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("x", [0.0, np.nextafter(32.0, 0.0), -1e-20, 16.0, np.nextafter(16.0, 0.0), -33.5, 1e6])
def test_positions_at_the_edges_are_in_their_tile(pool, x, dtype):
    made = cloud(pool, linear(dtype), (32, 32), n=50, speed=1e-9, field=0.0, x=x)
    advance(made, 2)
    for species in range(2):
        _, tiles, components = everybody(made, species)
        assert len(tiles) == 50
        assert (components[:, :2] >= 0).all()
        assert (components[:, :2] < 16).all()
        assert (tiles < 4).all()


def test_one_cell_may_hold_everybody(pool):
    made = cloud(pool, linear(np.float32), (64, 64), n=20000, speed=0.0, field=0.0, x=5.25)
    made.arena["charge"][1] *= -1
    for velocity in (0.0, 20.0):  # they stay, then all go to another tile at once
        made.arena["pool"][: made.pages.fresh, :, 2] = velocity
        advance(made, 1)
        assert made.patches.values.sum() == 40000 * 2**20
        assert made.patches.values.max() == 40000 * 2**20 * 9 // 16  # the nearest corner of (0.25, 0.25)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_a_velocity_that_is_no_motion_is_told(pool, bad):
    made = cloud(pool, linear(np.float64), (32, 32), n=200)
    page, pack, lane = made.arena["head"][0], 0, 0
    made.arena["pool"][page, pack, 2, lane] = bad
    with pytest.raises(Diverged):
        made.push(0)


@pytest.mark.parametrize(("v", "rotation"), [(2, 1), (3, 2)])
def test_speed_is_kept_in_a_magnetic_field(pool, v, rotation):
    """Three shears per plane round off, but do not drift: 1e-12 after 2000 turns of 0.2 rad."""
    made = cloud(pool, linear(np.float64, v, rotation), (32, 32), n=100, field=0.0, speed=0.1)
    before = np.sort(speeds(made))
    advance(made, 2000)
    assert np.abs(np.sort(speeds(made)) / before - 1).max() < 1e-12


@pytest.mark.parametrize("magnetic", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, -2.0, 3.0)])
def test_the_shears_turn_as_the_product_of_boris_about_any_axis(pool, magnetic):
    """Cells have unequal sides; the sense of the turn is that of the force q v x B."""
    made = cloud(pool, linear(np.float64, 3, 2), (32, 32), n=100, field=0.0, speed=0.1)
    side = np.array([0.5, 0.2, 0.5])
    t, s = rotation_vectors(magnetic, 1.5, 0.2, False)
    made.arena["mover"][:, 4:10] = shears(t, s, side)
    before = velocities(made) * side
    made.push(0)
    made.deliver()
    after = velocities(made) * side
    np.testing.assert_allclose(after, before + before @ turn(t, s).T, rtol=0, atol=1e-15)
    assert (np.sum((after - before) * np.cross(before, magnetic), axis=1) > 0).all()


def velocities(made):
    """Cells per step [n, 3] in order of the numbers."""
    numbers, _, components = everybody(made, 0)
    return components[np.argsort(numbers), 2:]


def speeds(made):
    return np.linalg.norm(everybody(made, 0)[2][:, 2:], axis=1)
