import itertools

import numpy as np
import pytest
from app_runner import running
from lattice_scenes import fluid_in_a_box

from hpcpic.core.comm.world import World
from hpcpic.core.simd.compile import njit
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool, bind
from lbmdem.app import shipped_cases
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid import temporal_blocking
from lbmdem.fluid.faces import Face
from lbmdem.fluid.fluid import Fluid
from lbmdem.forecast.estimate import steps_per_pass
from lbmdem.kernels.layout import arrival
from lbmdem.physics.reference import random_populations
from lbmdem.physics.velocity_sets import D2Q9, D3Q19
from lbmdem.sizes import CACHE_OF_WHOLE_PLANES, STEPS_PER_PASS

SHAPES = {"D2Q9": (40, 37), "D3Q19": (36, 26, 12)}


def make(lattice, periodic, *, world=None, threads=1, storage="double", faces=None, solid=0.1) -> Fluid:
    """Random populations and solid nodes."""
    world, shape = world or World.alone(), SHAPES[lattice.name]
    fluid = fluid_in_a_box(world, Pool(threads), lattice, shape, periodic, storage=storage, faces=faces)
    low, high = fluid.domain.row_range(world.rank)
    fluid.solid.inner[(np.random.default_rng(4).random(shape) < solid)[low:high]] = 1
    fluid.solid_changed()
    fluid.set_populations(random_populations(lattice, shape)[:, low:high])
    return fluid


def stepped(lattice, periodic, n: int, **options) -> np.ndarray:
    fluid = make(lattice, periodic, **options)
    for _ in range(n):
        fluid.step()
    return fluid.populations()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("lattice", "periodic"),
    [(D2Q9, (True, True)), (D2Q9, (False, True)), (D3Q19, (True, True, True)), (D3Q19, (False, False, True))],
)
def test_a_wave_has_the_bits_of_plain_steps(monkeypatch, lattice, periodic, threads):
    """Depths odd and even, with and without tiles of rows, from either parity, steps left over."""
    plain = stepped(lattice, periodic, 13)
    for depth, cache in itertools.product((2, 3, 4), (1.0, 1e9)):
        monkeypatch.setattr(temporal_blocking, "STEPS_PER_PASS", depth)
        monkeypatch.setattr(temporal_blocking, "CACHE", cache)
        fluid = make(lattice, periodic, threads=threads)
        fluid.step()
        assert fluid.depth == depth
        fluid.advance(12)
        assert fluid.iteration == 13
        assert np.array_equal(fluid.populations(), plain)


def single(piece, operations, sheet):
    """(step, plane, swept?)"""
    for step, swept, low, high in temporal_blocking.order(piece, operations, sheet):
        yield from ((step, plane, swept) for plane in range(low, high))


@pytest.mark.parametrize("sheet", [1, 3])
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("planes", "parts", "depth"), [(24, 1, 4), (24, 2, 5), (25, 3, 4)])
def test_blocks_and_gaps_do_every_plane_once_per_step_and_never_too_early(planes, parts, depth, periodic, sheet):
    pieces = temporal_blocking.blocks(planes, parts, periodic, periodic)
    pieces += [temporal_blocking.gap(piece.high) for piece in pieces if periodic or piece.high < planes]
    rows = temporal_blocking.row_tiles(30, periodic, 8, depth)
    done = np.zeros((planes, 30), int)
    for piece, row in itertools.product(pieces, rows):
        for step, plane, _ in single(piece, temporal_blocking.operations(depth, 0), sheet):
            for low, high in temporal_blocking.wrapped(row.at(step), 30):
                for y in range(low, high):
                    z = plane % planes
                    assert done[z, y] == step
                    for a, b in itertools.product((-1, 0, 1), repeat=2):
                        inside = periodic or (0 <= z + a < planes and 0 <= y + b < 30)
                        assert not inside or done[(z + a) % planes, (y + b) % 30] >= step
                    done[z, y] += 1
    assert (done == depth).all()


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("times", "sheet"), [(2, 1), (4, 1), (2, 5), (4, 5)])
@pytest.mark.parametrize(("planes", "parts", "depth"), [(24, 1, 4), (24, 2, 3), (39, 3, 3)])
def test_what_comes_after_a_sweep_finds_neighbours_swept_and_not_yet_again(
    planes, parts, depth, times, periodic, sheet
):
    pieces = temporal_blocking.blocks(planes, parts, periodic, periodic)
    pieces += [temporal_blocking.gap(piece.high) for piece in pieces if periodic or piece.high < planes]
    done, after = np.zeros(planes, int), np.zeros(planes, int)
    for piece in pieces:
        for step, plane, swept in single(piece, temporal_blocking.operations(depth, times), sheet):
            near = [k % planes for k in (plane - 1, plane, plane + 1) if periodic or 0 <= k < planes]
            seen = step - max(0, depth - times)  # of the earlier ones, after how many something came
            if swept:
                assert done[plane % planes] == step and (after[near] >= seen).all()
                done[plane % planes] += 1
            else:
                assert after[plane % planes] == seen and (done[near] == step + 1).all()
                after[plane % planes] += 1
    assert (done == depth).all() and (after == min(depth, times)).all()


def test_a_slab_too_thin_for_a_wave_is_stepped():
    fluid = make(D2Q9, (True, True))
    assert fluid.depth == STEPS_PER_PASS
    thin = Domain((5.0, 9.0), (5, 9), (True, True), (0, 5))
    assert temporal_blocking.possible_depth(thin, fluid.layout, 1, 0) == 2
    assert temporal_blocking.possible_depth(thin, fluid.layout, 2, 0) == 1
    fluid.hooks.append(lambda fluid, parity: None)
    assert fluid.depth == 1


FACES = {
    "x": {"x-": Face("pressure", density=1.02), "x+": Face("velocity", velocity=(0.01, 0.0, 0.0))},
    "z": {"z-": Face("pressure", density=1.02), "z+": Face("velocity", velocity=(0.0, 0.0, 0.01))},
    "lid": {"z-": Face("wall"), "z+": Face("wall", velocity=(0.05, 0.0, 0.0)), "y-": Face("wall"), "y+": Face("wall")},
}


def linked(faces, n: int, *, plain=False, world=None, threads=1) -> tuple[Fluid, np.ndarray]:
    """n steps with faces and a stand-in for links: arrivals are changed by those of their plane."""
    periodic = tuple(not any(name[0] == axis for name in faces) for axis in "zyx")
    fluid = make(D3Q19, periodic, world=world, threads=threads, faces=faces)
    layout = fluid.layout

    def links(parity: int, low: int, high: int, keep: bool) -> list:
        places = {"strides": layout.strides, "slots": layout.slots, "shifts": layout.shifts}
        return [bind(blend, f=fluid.f, parity=parity, low=low, high=high, nx=layout.nx, **places)]

    fluid.hooks.append(lambda fluid, parity: fluid.pool.each(links(parity, 0, layout.planes, True)))
    fluid.carry(None if plain else links)
    assert (fluid.depth == 1) is plain
    if plain:
        for _ in range(n):
            fluid.step()
    else:
        fluid.advance(n)
    return fluid, fluid.populations()


@njit
def blend(f, strides, slots, shifts, parity, low, high, nx):
    """What arrives at (z, 2, x) along 11 (plane up, row down) becomes half of it and half of what goes back."""
    for z in range(low, high):
        for x in range(nx):
            mine = arrival(strides, slots, shifts, parity, z, 2, x, 12)
            f[mine] = 0.5 * (f[mine] + f[arrival(strides, slots, shifts, parity, z, 2, x, 11)])


def same(plain, other) -> None:
    """Populations of the rows of a rank, and forces if there are."""
    fluid, h, *forces = other
    low, high = fluid.domain.row_range(fluid.world.rank)
    fluid.free()
    assert np.array_equal(h, plain[1][:, low:high]) and all(map(np.array_equal, forces, plain[2:]))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("faces", FACES.values(), ids=FACES)
def test_a_wave_carries_links_and_faces(faces, threads):
    same(linked(faces, 11, plain=True), linked(faces, 11, threads=threads))


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("faces", FACES.values(), ids=FACES)
def test_a_wave_carries_links_and_faces_through_ranks(world, faces):
    same(linked(faces, 11, plain=True), linked(faces, 11, world=world))


@pytest.mark.parametrize("whole", [CACHE_OF_WHOLE_PLANES, 25e3, 20e3, 1.0])
@pytest.mark.parametrize("n", range(1, 17))
def test_momentum_of_the_last_two_steps_is_kept_in_a_pass_or_by_hooks(monkeypatch, n, whole):
    """Also where planes that are done whole do not fit into the caches, or for fewer steps than others."""
    monkeypatch.setattr(temporal_blocking, "CACHE_OF_WHOLE_PLANES", whole)
    fluid, called, kept = make(D2Q9, (True, True)), [], []
    fluid.hooks.append(lambda fluid, parity: called.append(fluid.iteration + 1))

    def links(parity: int, low: int, high: int, keep: bool) -> list:
        kept.append((parity, keep))
        return []

    fluid.carry(links, take=called.append)
    fluid._quiet = True  # as of links that are at rest half-way
    fluid.advance(n)
    assert called[-2:] == [n - 1, n][-n:] and fluid.iteration == n
    assert len(called) <= (3 if whole > 1.0 else n) and all(keep for _, keep in kept)


def bed(n: int, *, plain=False, world=None, threads=1) -> tuple[Fluid, np.ndarray, np.ndarray]:
    """n steps of a flow between faces through fixed spheres, one across the seam; their forces."""
    faces = {"z-": Face("pressure", density=1.01), "z+": Face("pressure")}
    fluid = make(D3Q19, (False, True, True), world=world, threads=threads, faces=faces, solid=0.0)
    centres = np.array([[3.2, 6.1, 9.7], [8.9, 15.3, 20.2], [11.8, 22.2, 27.1]])
    still = np.zeros((3, 3))
    immersed = Immersed(fluid, fluid.world, fluid.pool, fixed=(np.arange(3), centres, np.full(3, 3.3), still, still))
    fluid.set_equilibrium()
    if plain:
        for _ in range(n):
            fluid.step()
    else:
        fluid.advance(n)
    return fluid, fluid.populations(), immersed.all_forces(3)[0]


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("n", [7, 8, 15])
def test_a_wave_through_a_fixed_bed_has_the_bits_and_forces_of_plain_steps(n, threads):
    plain, wave = bed(n, plain=True), bed(n, threads=threads)
    assert wave[0].depth > 1 and np.abs(plain[2]).max() > 0
    same(plain, wave)


@pytest.mark.parametrize("threads", [1, 2])
def test_links_of_a_step_beyond_the_caches_are_done_while_planes_are_in_them(monkeypatch, threads):
    plain = bed(9, plain=True)
    monkeypatch.setattr(temporal_blocking, "CACHE", 1.0)
    monkeypatch.setattr(Immersed, "_bounce", None)
    same(plain, bed(9, plain=True, threads=threads))


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("n", [9, 15])
def test_links_of_a_fixed_bed_on_several_ranks(world, monkeypatch, n):
    """Of plain steps beyond the caches, and of a wave."""
    plain = bed(n, plain=True)
    if n == 9:
        monkeypatch.setattr(temporal_blocking, "CACHE", 1.0)
    same(plain, bed(n, plain=n == 9, world=world))


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("lattice", "periodic"), [(D2Q9, (False, True)), (D3Q19, (True, True, True))])
def test_a_wave_through_several_ranks_has_the_bits_of_plain_steps(world, lattice, periodic, threads):
    plain = stepped(lattice, periodic, 9)
    fluid = make(lattice, periodic, world=world, threads=threads)
    assert fluid.depth > 1
    fluid.step()
    fluid.advance(8)
    same((None, plain), (fluid, fluid.populations()))


@pytest.mark.parametrize(
    ("case", "more"),
    [
        *((case, "") for case in ("taylor-green", "poiseuille", "couette", "sphere-array", "settling-disc")),
        ("restitution", ""),
        ("taylor-green", "shaking = { acceleration = [1e-4, 0.0]; frequency = 10.0; };"),
    ],
)
def test_the_estimate_knows_how_many_steps_a_pass_does(case, more):
    with running(World.alone(), "lbmdem", shipped_cases()[case].read_text() + more) as app:
        expected = 1 if app.dem or app.driven else app.fluid.depth
        assert steps_per_pass(app.scene.config, 1, 1) == expected


@pytest.mark.parametrize(("rule", "speed", "after"), [("halfway", 0.0, 0), ("halfway", 0.01, 6), ("cli", 0.0, 6)])
def test_links_that_every_sweep_bounces_back_are_nothing_more(rule, speed, after):
    domain = Domain((40.0,) * 2, (40, 40), (True,) * 2, (0, 40))
    place = (np.zeros(1, np.int64), np.array([[17.3, 18.1]]), np.array([4.2]))
    found = []
    for most in (14, 1):
        fluid = Fluid(World.alone(), Pool(1), domain, D2Q9, tau=0.8, force=(1e-4, 0.0))
        moved = (np.full((1, 2), speed), np.full((1, 1), speed))
        immersed = Immersed(fluid, fluid.world, fluid.pool, rule=rule, fixed=(*place, *moved))
        assert fluid.depth == temporal_blocking.possible_depth(domain, fluid.layout, 1, after)
        while fluid.iteration < 14:
            fluid.advance(most)
        found.append((fluid.populations(), *immersed.all_forces(1)))
    assert all(np.array_equal(a, b) for a, b in zip(*found))
