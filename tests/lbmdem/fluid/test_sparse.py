"""A porous medium held without its solid nodes: the bits of the fluid that holds them, and what it costs."""

import gc

import numpy as np
import pytest
from lattice_scenes import fluid_in_a_box

from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid import temporal_blocking
from lbmdem.fluid.faces import Face
from lbmdem.fluid.fluid import Fluid
from lbmdem.fluid.sparse import SparseLayout
from lbmdem.kernels import sparse
from lbmdem.kernels.link_arrays import Populations
from lbmdem.physics.reference import random_populations
from lbmdem.physics.velocity_sets import D2Q9, D3Q19

SHAPES = {"D2Q9": (40, 37), "D3Q19": (36, 14, 19)}
THROUGH = {"z-": Face("pressure", density=1.02), "z+": Face("velocity", velocity=(0.0, 0.0, 0.01))}
ACROSS = {"x-": Face("wall", velocity=(0.0, 0.02, 0.0)), "x+": Face("wall"), "z-": Face("wall"), "z+": Face("pressure")}


@pytest.fixture(autouse=True)
def masks(monkeypatch):
    """As on processors with masks: others hold all nodes."""
    monkeypatch.setattr("lbmdem.fluid.fluid.has_masks", lambda: True)


def porous(lattice, stays, *, faces=None, world=None, threads=1, storage="double", rule=None, solid=0.4) -> Fluid:
    """Random populations among random solid nodes, or (`rule`) among three spheres that are linked."""
    world, shape = world or World.alone(), SHAPES[lattice.name]
    names = "zyx"[-lattice.dimensions :]
    if lattice is D2Q9 and faces:
        names = "zx"
    periodic = tuple(not any(face[0] == axis for face in faces or {}) for axis in names)
    options = {"storage": storage, "force": (1e-4,) * lattice.dimensions, "faces": faces}
    fluid = fluid_in_a_box(world, Pool(threads), lattice, shape, periodic, **options)
    fluid.stays = stays
    low, high = fluid.domain.row_range(world.rank)
    fluid.set_populations(random_populations(lattice, shape)[:, low:high])
    if rule:
        centres = np.array([[3.2, 6.1, 9.7], [8.9, 12.3, 20.2], [11.8, 5.2, 33.1]])
        still = np.zeros((3, 3))
        spheres = (np.arange(3), centres, np.full(3, 6.1), still, still)
        fluid.immersed = Immersed(fluid, world, fluid.pool, rule=rule, fixed=spheres)
    else:
        fluid.solid.inner[(np.random.default_rng(4).random(shape) < solid)[low:high]] = 1
        fluid.solid_changed()
    assert isinstance(fluid.layout, SparseLayout) is stays
    return fluid


def seen(fluid: Fluid) -> list[np.ndarray]:
    """What can be seen after passes of one and of several steps that begin and end at either parity."""
    found = []
    for steps in (1, 12, 8, 15):
        fluid.advance(steps)
        found += [fluid.populations(), *np.moveaxis(fluid.moments()[1], -1, 0)]
    return found


def same(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


SCENES = [(D2Q9, None), (D3Q19, None), (D3Q19, THROUGH), (D3Q19, ACROSS)]
FEW = [(D2Q9, None, "single", 1), (D3Q19, THROUGH, "double", 1), (D3Q19, ACROSS, "double", 2)]
# The double D2Q9 takes 4 s to compile, the D3Q19 without faces 14 s and the single one 16 s.
ALL = [
    pytest.param(*one, marks=[] if one in FEW else pytest.mark.validation)
    for one in ((*scene, storage, n) for scene in SCENES for storage in ("double", "single") for n in (1, 2))
]


@pytest.mark.parametrize(("lattice", "faces", "storage", "threads"), ALL)
def test_a_fluid_without_its_solid_nodes_has_the_same_bits(lattice, faces, storage, threads):
    plain, thin = (porous(lattice, stays, faces=faces, storage=storage, threads=threads) for stays in (False, True))
    assert thin.depth > 1
    assert same(seen(plain), seen(thin))
    assert np.array_equal(plain.row_sums()[0], thin.row_sums()[0])


def groups_of_populations():
    gc.collect()
    return [one for one in gc.get_objects() if type(one) is Populations]  # isinstance asks proxies of what is gone


def test_solids_that_stay_keep_no_populations_of_a_fluid_that_holds_them():
    before = groups_of_populations()  # of other tests
    fluid = porous(D3Q19, True, rule="cli")
    made = [one for one in groups_of_populations() if not any(one is other for other in before)]
    assert not any(one.f.size > fluid.f.size for one in made)


AROUND = {"periodic": None, "through": THROUGH, "across": ACROSS}
RULED = [
    pytest.param(
        rule, faces, storage, id=f"{rule}-{around}-{storage}",
        marks=[] if storage == "double" and (r == k or rule == "cli") else pytest.mark.validation,
    )
    for r, rule in enumerate(("cli", "halfway", "interpolated"))
    for k, (around, faces) in enumerate(AROUND.items())
    for storage in ("double", "single")
]  # fmt: skip


@pytest.mark.parametrize(("rule", "faces", "storage"), RULED)
def test_links_in_the_sweep_have_the_bits_and_forces_of_those_after_it(rule, faces, storage):
    plain, thin = (porous(D3Q19, stays, faces=faces, storage=storage, rule=rule) for stays in (False, True))
    assert same(seen(plain), seen(thin))
    forces = [fluid.immersed.all_forces(3)[0] for fluid in (plain, thin)]
    assert np.array_equal(*forces) and np.abs(forces[0]).min() > 0


def test_links_of_the_sweep_are_half_done_between_passes_and_never_seen_so():
    fluid = porous(D3Q19, True, rule="cli")
    fluid.leap(100)
    half = fluid.f.copy()
    whole = fluid.populations()
    assert not np.array_equal(half, fluid.f)  # seeing them completes them, once
    assert np.array_equal(whole, fluid.populations())


@pytest.mark.parametrize("cache", [1.0, 1e9])
def test_steps_after_passes_have_the_same_bits_and_forces(monkeypatch, cache):
    """Where planes are done one by one while they are in caches, and where a step is done as a whole."""
    monkeypatch.setattr(temporal_blocking, "CACHE", cache)
    plain, thin = (porous(D3Q19, stays, rule="cli") for stays in (False, True))
    for steps in (6, 1, 1, 5, 1):
        plain.leap(steps)
        thin.leap(steps + 3)  # links stay half done
        for fluid in (plain, thin):
            while fluid.iteration % 10 < 9:
                fluid.step()
            fluid.step()
        assert plain.iteration == thin.iteration
        assert np.array_equal(plain.populations(), thin.populations())
        assert np.array_equal(plain.immersed.all_forces(3)[0], thin.immersed.all_forces(3)[0])


@pytest.mark.parametrize("after", [5, 8])
def test_it_goes_on_from_populations_of_either_parity(after):
    through, second = porous(D3Q19, True, rule="cli"), porous(D3Q19, True, rule="cli")
    through.advance(after)
    second.iteration = after
    second.set_populations(through.populations())
    assert same(seen(through), seen(second))


def test_every_kind_of_vector_is_there():
    """Else the comparisons above say little."""
    tables = porous(D3Q19, True, rule="cli")._arena
    assert 0 < np.count_nonzero(tables["kinds"] == sparse.WHOLE) < len(tables["kinds"])
    assert tables["linked"][-1] > 1000 and tables["rest"][-1] > 100
    first = tables["code"][: tables["rest"][1]] >> 16
    assert len(np.unique(first)) < len(first)  # more pieces than two in a direction


def test_a_node_costs_the_same_bytes_at_any_porosity():
    """19 populations and 14 bytes of masks and distances; in the quarter beside them are the ends of planes within a
    vector, at most an eighth here, and 8 bytes for each other piece of memory.
    """
    for solid in (0.2, 0.8):
        fluid = porous(D3Q19, True, solid=solid)
        nodes = np.count_nonzero(fluid.solid.inner < 0)
        assert fluid.sweep_bytes / nodes < 1.25 * (19 * 8 + 14)


def test_few_solid_nodes_are_kept_and_solids_that_stay_are_not_marked_twice():
    fluid = porous(D3Q19, True)
    with pytest.raises(ValueError, match="again"):
        fluid.solid_changed()
    open_fluid = Fluid(World.alone(), Pool(1), fluid.domain, D3Q19, tau=0.8)
    open_fluid.stays = True
    open_fluid.solid.inner[0, 0, 0] = 1
    open_fluid.solid_changed()
    assert not isinstance(open_fluid.layout, SparseLayout)


def test_all_nodes_are_held_where_a_processor_has_no_masks(monkeypatch):
    """There the fluid nodes alone take 1.2 to 2.3 times as long."""
    monkeypatch.setattr("lbmdem.fluid.fluid.has_masks", lambda: False)
    fluid = fluid_in_a_box(World.alone(), Pool(1), D3Q19, SHAPES["D3Q19"], (True,) * 3)
    fluid.stays = True
    fluid.solid.inner[::2] = 1
    fluid.solid_changed()
    assert not isinstance(fluid.layout, SparseLayout)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize(
    ("lattice", "faces", "rule", "threads"),
    [(D2Q9, None, None, 1), (D3Q19, None, None, 2), (D3Q19, THROUGH, "cli", 1), (D3Q19, None, "cli", 2),
     (D3Q19, ACROSS, "cli", 2)],
)  # fmt: skip
def test_ranks_do_not_show(world, lattice, faces, rule, threads):
    plain = porous(lattice, False, faces=faces, rule=rule)
    thin = porous(lattice, True, faces=faces, rule=rule, world=world, threads=threads)
    low, high = thin.domain.row_range(world.rank)
    axis = [1 if k % (1 + lattice.dimensions) == 0 else 0 for k in range(4 * (1 + lattice.dimensions))]
    whole = [np.take(values, range(low, high), axis=a) for values, a in zip(seen(plain), axis, strict=True)]
    found = seen(thin)
    forces = thin.immersed.all_forces(3)[0] if rule else np.zeros(1)
    thin.free()
    assert same(whole, found)
    if rule:
        assert np.array_equal(forces, plain.immersed.all_forces(3)[0])
