"""Balances of fluid and solids, walls, light grains, bits."""

from functools import partial

import numpy as np
import pytest
from app_runner import running
from lattice_scenes import fluid_in_a_box

from hpcpic.core.comm.world import World
from hpcpic.core.space import shapes
from hpcpic.core.space.domain import even_cuts
from hpcpic.core.tasks.graph import Pool
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.faces import Face
from lbmdem.fluid.surfaces import Wall
from lbmdem.kernels.layout import FLUID
from lbmdem.kernels.sweep import SKIP
from lbmdem.physics.velocity_sets import D2Q9, D3Q19
from lbmdem.physics.wall_rules import RULES, impedance

BOX = {"D3Q19": (13, 14, 17), "D2Q9": (26, 31)}
LATTICES = pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=lambda lattice: lattice.name)


def ball(centre, radius):
    return partial(shapes.ball, centre=centre, radius=radius)


def plane(point, normal):
    return partial(shapes.plane, point=point, normal=normal)


def stir(fluid, seed=1):
    """Populations away from equilibrium, the same for any cuts."""
    h = np.random.default_rng(seed).normal(size=(fluid.lattice.q, *fluid.domain.points))
    low, high = fluid.domain.row_range(fluid.world.rank)
    fluid.set_populations(0.01 * fluid.lattice.w.reshape(-1, *[1] * (h.ndim - 1)) * h[:, low:high])


class Grains:
    """Three grains that go their ways, whatever the fluid does; they turn and cross the seams."""

    def __init__(self, lattice, speed=0.05):
        d, rng = lattice.dimensions, np.random.default_rng(5)
        self.box = np.array(BOX[lattice.name][::-1], float)
        self.ids = np.array([0, 2, 3])
        self.x = np.array([[3.1, 3.2, 2.3], [10.2, 4.1, 7.3], [15.9, 11.3, 12.1]])[:, :d]
        self.x[:, -1] *= self.box[-1] / 13
        self.radii = np.array([2.6, 2.9, 2.2])
        self.v = rng.normal(0, speed, (3, d))
        self.omega = rng.normal(0, 0.3 * speed, (3, 3 if d == 3 else 1))

    def go(self):
        self.x = (self.x + self.v) % self.box

    @property
    def columns(self):
        return self.ids, self.x, self.radii, self.v, self.omega


def momentum(fluid):
    h = fluid.populations()
    return np.tensordot(h.reshape(len(h), -1).sum(axis=1), fluid.lattice.e, axes=1)


@LATTICES
@pytest.mark.parametrize("rule", RULES)
def test_what_the_fluid_loses_the_grains_get(alone, pool, lattice, rule):
    fluid = fluid_in_a_box(alone, pool, lattice, BOX[lattice.name])
    grains = Grains(lattice)
    walls = [Wall(ball((8.1,) * lattice.dimensions, 1.7))]
    rest = (0 * grains.v, 0 * grains.omega)
    immersed = Immersed(fluid, alone, pool, rule=rule, fixed=(*grains.columns[:3], *rest), walls=walls)
    stir(fluid)
    for _ in range(3):
        before = momentum(fluid)
        fluid.step()
        force = immersed.all_forces(4, steps=1)[0].sum(axis=0) + immersed.wall_forces(steps=1)[0].sum(axis=0)
        assert np.abs(force).max() > 1e-3
        assert np.abs(momentum(fluid) - before + force).max() < 1e-12  # sums of 1e4 terms of 1e-3


def rolling_ball(lattice):
    """A wall in the way of the grains."""
    d = lattice.dimensions
    return Wall(ball((9.1,) * d, 2.7), angular_velocity=(0.01, -0.02, 0.03)[: 3 if d == 3 else 1], centre=(9.1,) * d)


@LATTICES
@pytest.mark.parametrize("walls", [0, 1])
def test_conserving_refill_closes_both_balances(alone, pool, lattice, walls):
    fluid = fluid_in_a_box(alone, pool, lattice, BOX[lattice.name])
    grains = Grains(lattice)
    immersed = Immersed(fluid, alone, pool, refill="conserving", walls=[rolling_ball(lattice)] * walls)
    immersed.start(*grains.columns)
    stir(fluid)
    mass = fluid.populations().sum()
    changed = 0
    for _ in range(60):
        before, covered = momentum(fluid), fluid.ids.copy()
        grains.go()
        immersed.move(*grains.columns)
        changed += np.count_nonzero(covered != fluid.ids)
        fluid.step()
        force = immersed.all_forces(4, steps=1)[0].sum(axis=0) + immersed.wall_forces(steps=1)[0].sum(axis=0)
        assert np.abs(momentum(fluid) - before + force).max() < 2e-12
        assert abs(fluid.populations().sum() - mass) < 1e-12 * fluid.solid.inner.size
    assert changed > 60


@LATTICES
@pytest.mark.parametrize("walls", [0, 1])
def test_mass_conserving_refill_keeps_the_mass_and_is_local_otherwise(alone, pool, lattice, walls):
    fluids = []
    for refill in ("mass-conserving", "local"):
        fluid = fluid_in_a_box(alone, pool, lattice, BOX[lattice.name])
        grains = Grains(lattice)
        immersed = Immersed(fluid, alone, pool, refill=refill, walls=[rolling_ball(lattice)] * walls)
        immersed.start(*grains.columns)
        stir(fluid)
        mass = fluid.populations().sum()
        for _ in range(60):
            grains.go()
            immersed.move(*grains.columns)
            fluid.step()
        lost = abs(fluid.populations().sum() - mass) / fluid.solid.inner.size
        assert (lost < 1e-12) == (refill == "mass-conserving")
        fluids.append((fluid.moments()[1], immersed.all_forces(4)[0]))
    for kept, local in zip(*fluids) if not walls else ():  # a grain over the edge of a wall feels the pressure there
        np.testing.assert_allclose(kept, local, atol=0.02 * np.abs(local).max())


@LATTICES
@pytest.mark.parametrize("refill", ["average", "local", "non-equilibrium", "mass-conserving"])
def test_other_refills_keep_the_momentum_on_the_mean(alone, pool, lattice, refill):
    """A grain in a fluid that moves with it: what is refilled is what was there, up to rounding, and no force acts."""
    fluid = fluid_in_a_box(alone, pool, lattice, BOX[lattice.name])
    grains = Grains(lattice)
    grains.v[:], grains.omega[:] = 0.04, 0.0
    immersed = Immersed(fluid, alone, pool, refill=refill)
    immersed.start(*grains.columns)
    fluid.set_equilibrium(1.0, (0.04,) * lattice.dimensions)
    for _ in range(30):
        grains.go()
        immersed.move(*grains.columns)
        fluid.step()
        density, u = fluid.moments()
        free = fluid.solid.inner == -1
        assert np.abs(density[free] - 1.0).max() < 1e-13
        assert np.abs(u[free] - 0.04).max() < 1e-13
        assert np.abs(immersed.all_forces(4)[0]).max() < 0.02  # less than 2 % of the momentum that a grain sweeps over


@LATTICES
def test_the_average_makes_no_jump_of_pressure_in_a_fluid_of_another_mean_density(alone, pool, lattice):
    """As before. Links push by the density of rest ([6]), which shifts densities by a tenth of the excess of 0.02."""
    fluid = fluid_in_a_box(alone, pool, lattice, BOX[lattice.name])
    grains = Grains(lattice)
    grains.v[:], grains.omega[:] = 0.04, 0.0
    immersed = Immersed(fluid, alone, pool, refill="average")
    immersed.start(*grains.columns)
    fluid.set_equilibrium(1.02, (0.04,) * lattice.dimensions)
    changed = 0
    for _ in range(30):
        grains.go()
        before = fluid.ids.copy()
        immersed.move(*grains.columns)
        changed += np.count_nonzero((before != fluid.ids) & (fluid.ids == -1))
        density = fluid.moments()[0][fluid.solid.inner == -1]
        assert np.abs(density - 1.02).max() < 0.25 * 0.02
        fluid.step()
    assert changed > 20


def test_no_force_between_touching_grains_in_still_fluid(world, pool):
    fluid = fluid_in_a_box(world, pool, D3Q19, (16, 12, 12))
    x = np.array([[5.3, 5.1, 4.2], [5.3, 5.1, 10.2]])
    rest = np.zeros((2, 3))
    immersed = Immersed(fluid, world, pool, fixed=(np.arange(2), x, np.array([3.0, 3.0]), rest, rest))
    for _ in range(3):
        fluid.step()
        force, torque = immersed.all_forces(2)
        assert np.all(force == 0.0) and np.all(torque == 0.0)
    assert immersed.counts()["fallbacks"] > 0


def couette(world, pool, rule, q, height=6, u=0.01):
    """Largest error of the steady flow between a wall at rest and one that moves, at a fraction q of the links."""
    fluid = fluid_in_a_box(world, pool, D2Q9, (height + 3, 4), tau=0.9)
    low, high = 1.0 - q, height + q  # nodes 1 .. height are fluid
    walls = [Wall(plane((0.0, low), (0.0, 1.0))), Wall(plane((0.0, high), (0.0, -1.0)), velocity=(u, 0.0))]
    Immersed(fluid, world, pool, rule=rule, walls=walls)
    fluid.advance(1500)
    exact = u * (np.arange(1, height + 1) - low) / (high - low)
    return np.abs(fluid.moments()[1][1 : height + 1, :, 0] - exact[:, None]).max() / u


@pytest.mark.parametrize("q", [0.05, 0.3, 0.5, 0.7, 1.0])
def test_couette_flow_is_exact_for_rules_of_second_order(alone, pool, q):
    for rule in ("cli", "interpolated", "quadratic"):
        assert couette(alone, pool, rule, q) < 1e-9, rule
    first_order = abs(0.5 / 6 - q / (5 + 2 * q))  # its walls are half-way in any case
    assert couette(alone, pool, "halfway", q) == pytest.approx(first_order, abs=1e-9)


def poiseuille(world, pool, rule, q, height):
    """Relative error of the mean flow between two walls under a force."""
    viscosity, tau = 1 / 6, 1.0
    low, high = 1.0 - q, height + q
    force = 8 * viscosity * 0.001 / (high - low) ** 2
    fluid = fluid_in_a_box(world, pool, D2Q9, (height + 3, 4), tau=tau, force=(force, 0.0))
    Immersed(fluid, world, pool, rule=rule, walls=[Wall(plane((0, low), (0, 1))), Wall(plane((0, high), (0, -1)))])
    y = np.arange(height + 3)[:, None]
    exact = np.broadcast_to(force / (2 * viscosity) * (y - low) * (high - y), (height + 3, 4))
    fluid.set_equilibrium(1.0, np.stack((exact, 0 * exact), axis=-1))
    fluid.advance(int(8 * height**2))
    return np.abs((fluid.moments()[1][1 : height + 1, :, 0] - exact[1 : height + 1]).mean()) / exact[1:-2].mean()


@pytest.mark.parametrize("rule", ["cli", "interpolated"])
@pytest.mark.parametrize("q", [0.2, 0.8])
def test_poiseuille_flow_is_of_second_order_at_any_place_of_the_wall(alone, pool, rule, q):
    coarse, fine = (poiseuille(alone, pool, rule, q, height) for height in (6, 12))
    assert fine < 1e-9 or np.log2(coarse / fine) > 1.8
    assert fine < 0.03


@LATTICES
@pytest.mark.parametrize("rule", ["halfway", "interpolated", "cli"])
def test_impedance_is_the_change_of_the_force_with_the_velocity(world, pool, lattice, rule):
    """Links of a grain in a fluid at rest, at several places: the mean of -dF/du and of -dT/dw."""
    shape, d = (18,) * lattice.dimensions, lattice.dimensions
    fluid = fluid_in_a_box(world, pool, lattice, shape)
    immersed, turns = Immersed(fluid, world, pool, rule=rule), 3 if d == 3 else 1
    found = []
    u = 1e-4
    for k in range(12):
        x = np.full((1, d), 8.0) + np.random.default_rng(k).random(d)
        fluid.set_equilibrium(1.0)
        immersed.start(np.array([0]), x, np.array([5.2]), np.full((1, d), u), np.full((1, turns), u))
        fluid.step()
        force, torque = immersed.all_forces(1, steps=1)
        found.append((-force.mean() / u, -torque.mean() / u))
    wanted = impedance(lattice, rule, np.array([5.2]))
    assert np.mean(found, axis=0) == pytest.approx(np.ravel(wanted), rel=0.04)


def settle(world, pool, ratio, implicit, steps=400):
    """Velocity of a disc of this density ratio under its weight at the end; the box gives the momentum back."""
    fluid = fluid_in_a_box(world, pool, D2Q9, (40, 40), tau=0.8)
    immersed, radius = Immersed(fluid, world, pool), np.array([3.0])
    mass = ratio * np.pi * radius**2
    added = impedance(D2Q9, "cli", radius)[0] if implicit else 0.0
    x, v, still = np.array([[20.3, 20.1]]), np.zeros((1, 2)), np.zeros((1, 1))
    force = np.array([[1e-3, 0.0]])
    for _ in range(steps):
        immersed.move(np.array([0]), x, radius, v, still)
        fluid.step()
        v = v + (immersed.all_forces(1)[0] + force) / (mass + added)
        if not np.abs(v).max() < 0.3:
            return np.inf
        x = (x + v) % 40
    return v[0, 0]


def test_light_grains_are_stable_with_the_impedance_only(alone, pool):
    assert settle(alone, pool, 0.05, implicit=False) == np.inf
    light, heavier = settle(alone, pool, 0.001, implicit=True), settle(alone, pool, 1.0, implicit=False)
    assert 0 < light == pytest.approx(heavier, rel=0.5)


def trajectory(world, pool, lattice, refill, blocks, steps=12, rule="cli"):
    """Populations and forces at the end, all rows."""
    fluid = fluid_in_a_box(world, pool, lattice, BOX[lattice.name], blocks=blocks)
    grains = Grains(lattice)
    immersed = Immersed(fluid, world, pool, rule=rule, refill=refill, walls=[rolling_ball(lattice)])
    immersed.start(*grains.columns)
    stir(fluid)
    for _ in range(steps):
        fluid.step()
        grains.go()
        immersed.move(*grains.columns)
    own = np.moveaxis(fluid.populations(), 0, -1)
    forces = [np.hstack(immersed.all_forces(4)), np.hstack(immersed.wall_forces())]
    result = own, np.vstack(forces), immersed.counts()
    immersed.free()
    fluid.free()
    return result


def same(one, other):
    assert np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1]) and one[2] == other[2]


@LATTICES
@pytest.mark.parametrize("refill", ["average", "non-equilibrium", "mass-conserving", "conserving"])
def test_blocks_and_threads_do_not_change_a_bit(alone, pool, lattice, refill):
    pair = Pool(2)
    same(trajectory(alone, pool, lattice, refill, 1), trajectory(alone, pair, lattice, refill, 5))
    pair.close()


@LATTICES
@pytest.mark.parametrize("rule", ["quadratic", "cli"])
def test_links_are_done_as_soon_as_the_planes_that_they_read_are_swept(alone, pool, lattice, rule):
    """Blocks of a plane each; one thread takes links before other planes. No bit depends on it."""
    same(*(trajectory(alone, pool, lattice, "local", blocks, rule=rule) for blocks in (1, BOX[lattice.name][0])))


@pytest.mark.mpi(min_size=2)
@LATTICES
@pytest.mark.parametrize("refill", ["average", "non-equilibrium", "mass-conserving", "conserving"])
def test_ranks_do_not_change_a_bit(world, pool, lattice, refill):
    h, *whole = trajectory(World.alone(), pool, lattice, refill, 1)
    low, high = np.array(even_cuts(BOX[lattice.name][0], world.size))[world.rank : world.rank + 2]
    same((h[low:high], *whole), trajectory(world, pool, lattice, refill, 2))


@pytest.mark.parametrize("implicit", [True, False])
def test_the_force_does_not_alternate_from_step_to_step(alone, pool, implicit):
    """A settling disc, little heavier than the fluid, at a small relaxation time: second difference below W / 5."""
    fluid = fluid_in_a_box(alone, pool, D2Q9, (60, 60), tau=0.6)
    immersed, radius, weight = Immersed(fluid, alone, pool), np.array([5.0]), 2e-3
    mass = 1.01 * np.pi * 25.0 + (impedance(D2Q9, "cli", radius)[0] if implicit else 0.0)
    x, v, drag = np.array([[30.3, 30.1]]), np.zeros((1, 2)), []
    immersed.start(np.array([0]), x, radius, v, np.zeros((1, 1)))
    for _ in range(240):
        fluid.step()
        force = immersed.all_forces(1)[0]
        drag.append(force[0, 1])
        v = v + (force - (0.0, weight)) / mass
        x = (x + v) % 60
        immersed.move(np.array([0]), x, radius, v, np.zeros((1, 1)))
    assert np.abs(np.diff(drag[40:], 2)).max() / 4 < 0.2 * weight


BOXES = {
    "periodic": (D3Q19, (20, 23, 37), (True, True, True), {}),
    "walls": (D3Q19, (20, 23, 26), (True, False, True), {}),
    "flat": (D2Q9, (40, 50), (True, False), {}),
    "open": (
        D3Q19,
        (20, 23, 26),
        (True, True, False),
        {"x-": Face("velocity", 1.0, (0.01, 0, 0)), "x+": Face("pressure")},
    ),
}


@pytest.mark.parametrize("box", BOXES)
def test_what_the_sweep_knows_of_changed_nodes_is_what_it_finds_in_all(world, pool, box):
    lattice, shape, periodic, faces = BOXES[box]
    fluid = fluid_in_a_box(world, pool, lattice, shape, periodic, faces=faces)
    immersed, d, rng = Immersed(fluid, world, pool), lattice.dimensions, np.random.default_rng(1)
    size = np.array(shape[::-1], float)
    x, v, radii = rng.uniform(0, 1, (18, d)) * size, rng.normal(0, 0.4, (18, d)), rng.uniform(1, 5.5, 18)
    radii[0], v[-3:] = 12.0, 0.0  # a vector without fluid; grains that stay
    immersed.start(np.arange(18), x, radii, v, np.zeros((18, 3 if d == 3 else 1)))
    changed = 0
    for _ in range(30):
        x, before = (x + v) % size, fluid.ids.copy()
        immersed.move(np.arange(18), x, radii, v, np.zeros((18, 3 if d == 3 else 1)))
        changed += np.count_nonzero(fluid.ids != before)
        words = fluid._arena
        skipped = words["kinds"] == SKIP
        kept = [part.copy() for part in (fluid.ids, words["wet"], words["kinds"], words["hops"][skipped])]
        fluid.solid_changed(fill=False)
        for part, anew in zip(kept, (fluid.ids, words["wet"], words["kinds"], words["hops"][skipped])):
            assert np.array_equal(part, anew)
    assert changed > 1000 and skipped.any()


@pytest.mark.parametrize("rule", RULES)
def test_forces_do_not_depend_on_who_has_asked_before(world, pool, rule):
    """They are summed when somebody asks: at every step here, and there after the last one only."""
    told = []
    for often in (True, False):
        fluid = fluid_in_a_box(world, pool, D2Q9, (16, 16), force=(1e-5, 2e-5))
        grain = (np.zeros(1, np.int64), np.array([[7.3, 8.1]]), np.array([4.2]), np.full((1, 2), 0.01), np.ones((1, 1)))
        immersed = Immersed(fluid, world, pool, rule=rule, fixed=grain)
        for step in range(5):
            fluid.step()
            if often or step == 4:
                last = [*immersed.all_forces(1), *immersed.all_forces(1, steps=1), immersed.pending(1)]
        told.append(last)
    assert all(np.array_equal(a, b) and np.abs(a).max() > 0 for a, b in zip(*told))


def linked(world, pool, lattice, shape, rule, grains, walls=()):
    """Populations, forces and counts after two steps, of grains that stay and of those that are linked anew.

    Bounds: rounding of some hundred links of numbers below 1.
    """
    found = []
    for moves in (False, True):
        fluid = fluid_in_a_box(world, pool, lattice, shape)
        immersed = Immersed(fluid, world, pool, rule=rule, walls=walls, **({} if moves else {"fixed": grains}))
        if moves:
            immersed.start(*grains)
        stir(fluid)
        fluid.step()
        fluid.step()
        found.append((fluid.populations(), *immersed.forces(grains[0]), *immersed.wall_forces(), immersed.counts()))
    (h, *forces, counts), (moving, *others, moving_counts) = found
    np.testing.assert_allclose(moving, h, atol=1e-15)
    for force, other in zip(forces, others):
        np.testing.assert_allclose(other, force, atol=1e-12 * grains[2].max())
    return counts, moving_counts, forces


@LATTICES
@pytest.mark.parametrize("rule", ["interpolated", "quadratic", "cli"])
def test_wide_grains_are_linked_as_if_they_stayed(alone, pool, lattice, rule):
    """Of more planes and columns than are looked at together, across the seams."""
    d = lattice.dimensions
    shape, radius = {2: ((90, 90), 38.3), 3: ((44, 44, 44), 16.6)}[d]
    grain = (np.array([7]), np.full((1, d), 3.4), np.array([radius]), np.full((1, d), 0.01))
    counts, moving_counts, _ = linked(
        alone, pool, lattice, shape, rule, (*grain, np.full((1, 3 if d == 3 else 1), 1e-3))
    )
    assert counts == moving_counts and counts["links"] > 300


@LATTICES
@pytest.mark.parametrize("rule", RULES)
def test_grains_beside_a_wall_are_linked_as_if_they_stayed(alone, pool, lattice, rule):
    """One covers nodes beside the wall and of it, one leaves a gap below a node, one of two."""
    d, grains, shape = lattice.dimensions, Grains(lattice), BOX[lattice.name]
    for x, radius, gap in zip(grains.x, grains.radii, (-1.3, 0.4, 2.1)):
        away = np.array([1.0, 0.4, -0.7])[:d] * (1 if gap < 0 else -1) * [1, gap, 1][:d]
        x[:] = 9.1 + (2.7 + radius + gap) * away / np.linalg.norm(away)
    walls = [rolling_ball(lattice)]
    counts, moving_counts, forces = linked(alone, pool, lattice, shape, rule, grains.columns, walls)
    assert counts["links"] == moving_counts["links"] > 100 and counts["fallbacks"] == moving_counts["fallbacks"]
    assert np.abs(np.hstack(forces[2:])).min() > 1e-5


@LATTICES
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("periodic", [True, False], ids=["periodic", "walls"])
def test_populations_in_moving_grains_mean_nothing(alone, pool, lattice, rule, periodic):
    """No number there changes a bit of the fluid or of a force: beside seams and walls, where grains come and go; rows
    are whole vectors, as those are done without a look at what is solid."""
    d, seen = lattice.dimensions, []
    shape = (12, 11, 32)[3 - d :]
    x = np.array([[0.4, 5.2, 1.3], [10.1, 5.4, 5.2], [18.2, 9.8, 9.8], [21.7, 4.1, 10.2]])[:, -d:]
    x[:, 0] = [0.4, 10.1, 18.2, 21.7]
    v = np.random.default_rng(4).normal(0.0, 0.2, x.shape)
    for filled in (0.0, np.nan, -7.0):
        fluid = fluid_in_a_box(alone, pool, lattice, shape, periodic=(periodic,) * d)
        immersed = Immersed(fluid, alone, pool, rule=rule, walls=[Wall(ball((14.1, 7.2, 6.9)[:d], 2.3))])
        grains = (np.arange(4), x.copy(), np.array([2.6, 2.2, 2.9, 2.4]), v, np.full((4, 3 if d == 3 else 1), 0.01))
        immersed.start(*grains)
        stir(fluid)
        told = []
        for _ in range(6):
            h = fluid.populations()
            h[:, fluid.solid.inner != FLUID] = filled
            fluid.set_populations(h)
            fluid.step()
            told.append(np.vstack([np.hstack(immersed.forces(grains[0])), np.hstack(immersed.wall_forces())]))
            grains[1][...] += v
            immersed.move(*grains)
        seen.append((fluid.populations(), told, fluid.rest_bounds()))
    assert np.isfinite(seen[0][0]).all()
    for other in seen[1:]:
        assert [np.array_equal(a, b) for a, b in zip(seen[0], other)] == [True] * 3


SHOT = """
simulation = { end_time = 1.0; };
domain = { size = [8.0e-3, 8.8e-3]; spacing = 2.0e-4; periodic = ["x", "y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; };
coupling = { refill = "conserving"; };
grains = ({ diameter = 2.0e-3; density = 2650.0; position = [4.1e-3, 4.7e-3]; velocity = [4.0e-3, 2.0e-3]; });
"""


def test_a_grain_and_the_fluid_share_its_momentum(world):
    """From the first step on, whatever `coupling.inertia` is: the grain is heavier than the impedance of its links.
    Half of the last force is still to come; in some steps nodes change hands, whose momentum comes a step later."""
    with running(world, "lbmdem", SHOT) as app:
        first, off = app.table.mass[0] * app.dem.grains.v[0], []
        for _ in range(40):
            app.step()
            last = app.immersed.all_forces(1, steps=1)[0][0] * app.scene.units.force
            fluid = [app.scalars()[f"momentum_{axis}"] for axis in "xy"]
            now = app.table.mass[0] * app.dem.grains.v[0] + 0.5 * app.time_step * last
            off.append(np.linalg.norm(fluid + now - first))
        assert app.dem.grains.v[0, 0] < 2e-3
        assert sorted(off)[10] < 1e-12 * np.linalg.norm(first)
        assert off[-1] < 0.03 * np.linalg.norm(first)
