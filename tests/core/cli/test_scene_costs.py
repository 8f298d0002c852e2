"""A scene costs what is in it: plans against bytes that are held, messages that are sent and calls that are made.

Times are for scripts/scene_costs.py, whose scenes these are.
"""

import gc
import importlib.util
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from app_runner import launch
from seldom import seldom
from toy_runner import environment

from hpcpic.core.app.forecast import OF_EVERY_RUN
from hpcpic.core.comm.messages import Messages
from hpcpic.core.comm.tags import CHANNELS, Channel
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from lbmdem.coupling.arrays import MOVING_LINKS
from lbmdem.fluid.arrays import MOVED_NODES
from lbmdem.grains.arrays import CONTACTS, GRAINS
from sph.physics.fluxes import FLUXES
from sph.physics.viscosities import VISCOSITIES

SPEC = importlib.util.spec_from_file_location("scene_costs", Path(__file__).parents[3] / "scripts/scene_costs.py")
scenes = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = scenes
SPEC.loader.exec_module(scenes)
flow, plasma, spheres, water = scenes.flow, scenes.plasma, scenes.spheres, scenes.water
MAIN = {"hpcpic": "hpcpic.__main__", "sph": "sph.__main__", "lbmdem": "lbmdem.__main__"}
TANK = """wall = ( {{ name = "tank"; type = "{kind}"; shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 1.0]; }}; }};
                    }} );"""
IONS = """, { name = "ions"; particles = 20000; charge = 1.0; mass = 64.0; plasma_frequency = 0.125;
              init_method = "random position"; thermal_velocity = 0.01; }"""

LINK_ARRAYS = {"node", "weights", "body", "arm", "kept", "start", "offsets", "direction", "way", "sums", "scale"}
PLASMAS = plasma(64, 150_000), plasma(64, 300_000)
WATERS = water(spacing=0.005), water(high=(1, 2), top=(0.5, 1.0), spacing=0.005)
FLOWS = flow((128, 128)), flow((128, 256))


def planned(case, ranks=1):
    app, config = scenes.app_and_config(case)
    return app.plan(config, ranks, 1)


def changed(without, with_it):
    """First words of the lines that a plan has more, and of those it has less, when numbers are left out."""

    def heads(case):
        lines = (line for line in planned(case) if line.startswith("  "))
        return {re.split(r"  |:", line.strip())[0] for line in lines}

    a, b = heads(without), heads(with_it)
    return b - a, a - b


@pytest.fixture(scope="module")
def held(pool):
    """Bytes of a scene, measured once. Each time garbage is looked for twice, which need not look at all that the
    tests before have left: 0.7 s late in a run of all.
    """
    gc.collect()
    gc.freeze()
    return cache(lambda case: scenes.held(case, pool))


def test_empty_space_costs_nothing(held):  # C1
    """A box a million times as large around the same water."""
    assert held(water(high=(1000, 1000))) <= 1.05 * held(water())


def test_only_moving_grains_have_contacts(pool):  # C4
    """Fixed ones are linked once: nobody looks for them again."""
    fixed, moving = (flow((32, 32), spheres((32, 32), 32, 6.0, moves)) for moves in (False, True))
    calls = []
    with scenes.running(fixed, pool) as app:
        app.immersed.move = app.immersed.start = lambda *grains: calls.append(grains)
        for _ in range(3):
            app.step()
        assert app.dem is None and not calls
    more, less = changed(fixed, moving)
    linked_anew = {array.name for array in (*MOVING_LINKS, *MOVED_NODES)}
    assert more == {"contacts", "refill"} | {array.name for array in (*GRAINS, *CONTACTS)} | linked_anew - LINK_ARRAYS
    assert less == LINK_ARRAYS - linked_anew  # of one name: another array


@pytest.mark.parametrize(
    ("without", "with_it", "expected"),
    [
        (water(), water(flux="rusanov"), {"density flux"}),
        (water(), water(form="cleary", more="dynamic_viscosity = 1.0;"), {"viscosity"}),
        (water(), water(walls=TANK.format(kind="mirror-no-slip")), {"walls"}),
        (water(), water(integrator="rk3-tvd"), {"x_old", "v_old", "drho_old"}),
        (water(gravity=0.0), water(), set()),
        (flow((32, 32)), flow((32, 32), spheres((32, 32), 32, 6.0)), {"links"} | LINK_ARRAYS),
        (plasma(particles=0), plasma(), {"push", "deliver", "collect", "solve", "gradient", "particles",
                                         "numbers of the particles"}),
    ],
    ids=["flux", "viscosity", "walls", "stages", "gravity", "grains", "particles"],
)  # fmt: skip
def test_each_part_of_the_physics_brings_its_lines_alone(without, with_it, expected):  # C7
    more, less = changed(without, with_it)
    assert more == expected and all(line.startswith("none") for line in less)


def test_terms_that_a_scene_has_not_are_not_compiled(pool):  # C7
    """What the plan of the water leaves out is in neither the law of its kernels nor the arrays of its bodies."""
    with scenes.running(water(high=(0.2, 0.2), top=(0.1, 0.1)), pool) as app:
        law, arena = app.spec, app.tasks.arena
        assert (law.flux, law.viscosity, law.artificial) == (FLUXES["none"], VISCOSITIES["none"], False)
        assert not (law.walls or law.tensile or law.shifting or law.corrected or law.repulsive)
        empty = {name for name in arena.declared if not arena[name].size}
    assert empty >= {"x_old", "v_old", "drho_old", "gradient", "shear", "matrix", "offset"}


def test_without_particles_nothing_is_done(pool, monkeypatch):  # C8
    with scenes.running(plasma(64, 0), pool) as app:
        monkeypatch.setattr(pool, "each", None)
        monkeypatch.setattr(pool, "run", None)
        for _ in range(3):
            app.step()
        assert app.iteration == 3 and not app.mesh.e.any()


def test_an_immobile_background_is_a_number(pool):  # C9
    """The charge of the ions that nobody follows is the mean of the Poisson equation, and they have no bytes."""
    with scenes.running(plasma(), pool) as app:
        assert app.cloud.n == 20_000 and app.mesh.rho.mean() < 0  # of the electrons alone
        assert abs(app.mesh.phi.inner.mean()) < 1e-12 * np.abs(app.mesh.phi.inner).max()  # k = 0 is left out
    alone, both = (dict(memory(case)) for case in (plasma(), plasma(more=IONS)))
    assert both["particles"] == pytest.approx(2 * alone["particles"], rel=0.01)  # half a page for each tile


def memory(case):
    app, config = scenes.app_and_config(case)
    return app.estimate(config, 1, 1, {}).memory.items()


@pytest.mark.parametrize(
    ("cases", "items", "least", "most"),
    [
        (PLASMAS, 150_000, 4 * 8 + 4, 1.25),  # positions, velocities and numbers
        (FLOWS, 128 * 128, 9 * 8 + 4, 1.25),  # populations, and what is solid
        # Positions, velocities, accelerations, density, its rate, mass, number, flags. The aim is 1.25; where
        # neighbours are makes it 1.6.
        (WATERS, 10_000, 80, 1.7),
    ],
    ids=["plasma", "lattice", "water"],
)
def test_bytes_of_a_particle_or_node(held, cases, items, least, most):  # C10
    """Close to the least there can be, and to those of the plan: but for pages and rows that are part-filled."""
    found, planned = ((size(cases[1]) - size(cases[0])) / items for size in (held, scenes.planned_bytes))
    assert least <= found <= most * least
    assert found == pytest.approx(planned, rel=0.12)


@pytest.mark.parametrize("case", [plasma(), water(), flow((32, 32))], ids=["plasma", "water", "lattice"])
def test_snapshots_are_off_until_asked_for_and_then_have_a_price(case):  # C11
    app, config = scenes.app_and_config(case)
    disk = app.estimate(config, 1, 1, {}).disk
    assert disk["particles" if case.program == "sph" else "fields"] == 0
    asked = {
        "hpcpic": ("output = {", "output = { sampling_period = { field = 10; }; };", "fields"),
        "sph": ("output = {", "output = { period = { particles = 0.1; }; };", "particles"),
        "lbmdem": ("output = {", "output = { period = { fields = 0.1; }; };", "fields"),
    }[case.program]
    app, config = scenes.app_and_config(scenes.Case(case.program, case.text + asked[1]))
    assert app.estimate(config, 1, 1, {}).disk[asked[2]] > 0


OF_SCENES = {"scipy.sparse", "scipy.special", "trimesh", "pyfftw", "matplotlib", "rich"}  # that some runs import


@pytest.mark.parametrize(
    ("program", "words", "more"),
    [
        seldom("hpcpic", ["landau-damping", "simulation.cycles=2"], {"FFTW"}),
        ("hpcpic", ["thesis-10240-on-64", "simulation.cycles=2", 'simulation.solver="LU"'], {"scipy.sparse"}),
        ("sph", ["water-column", "numerics.spacing=0.05", "simulation.end_time=1e-3"], set()),
        ("lbmdem", ["couette", "simulation.end_time=1e-3"], set()),
    ],
)
def test_a_run_imports_what_its_plan_says(program, words, more, tmp_path):
    case, *sets = words
    options = [word for text in sets for word in ("--set", text)]
    plan = launch(1, "-m", MAIN[program], "check", case, *options, "--plan").stdout.splitlines()
    told = plan[plan.index("imports of a run") + 1].strip().split(", ")
    run = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", MAIN[program], "run", case, *options, "-o", str(tmp_path / "run")],
        capture_output=True, text=True, env=environment(),
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    seen = {line.rsplit("|")[-1].strip() for line in run.stderr.splitlines() if line.startswith("import time")}
    names = {name.split()[0] for name in told}
    assert set(OF_EVERY_RUN) <= seen and names - set(OF_EVERY_RUN) == more
    assert seen & OF_SCENES == more & OF_SCENES and ("hpcpic.core.comm.fftw" in seen) == ("FFTW" in more)


@pytest.mark.parametrize(
    ("program", "words", "code"),
    [
        ("sph", ["check", "still-tank", "--plan"], 0),
        ("lbmdem", ["check", "poiseuille", "--plan"], 0),
        ("hpcpic", ["check", "landau-damping", "--set", "grid.points=[0]"], 2),
    ],
    ids=["sph", "lbmdem", "refused"],
)
def test_plans_and_refusals_load_no_compiler_and_no_mpi(program, words, code, tmp_path):  # C12, beside test_verbs
    look = (
        f"import sys; sys.argv = [{program!r}, *{words!r}]\n"
        f"from {MAIN[program]} import load_app\n"
        "from hpcpic.core.cli.main import build\n"
        "try:\n"
        f"    build(load_app, {program!r}, 'anything')()\n"
        "except SystemExit as end:\n"
        "    code = end.code\n"
        "heavy = {'mpi4py', 'numba', 'h5py', 'pyfftw', 'scipy', 'matplotlib'} & set(sys.modules)\n"
        "sys.stderr.write(f'loaded={sorted(heavy)} code={code}')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", look], cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=30
    )
    assert done.stderr.endswith(f"loaded=[] code={code}"), done.stderr


def test_only_the_plasma_loads_a_fourier_transform(tmp_path):  # C12
    code = (
        f"import sys; sys.path.insert(0, {str(Path(scenes.__file__).parent)!r})\n"
        "import scene_costs as s\n"
        "pool = s.Pool(1)\n"
        "for case in (s.flow((16, 16)), s.water(high=(0.2, 0.2), top=(0.1, 0.1))):\n"
        "    s.made(case, pool).step()\n"
        "print(sorted({'pyfftw', 'h5py', 'matplotlib'} & set(sys.modules)))"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=110)
    assert done.stdout.strip() == "[]", done.stderr


class Forbidden:
    """An MPI communicator that nobody may use."""

    def __getattr__(self, name):
        raise AssertionError(f"one rank calls MPI: {name}")


@pytest.mark.parametrize("case", [plasma(), water(), flow((32, 32))], ids=["plasma", "water", "lattice"])
def test_one_rank_sends_no_messages(pool, case):  # C13
    world = World.alone()
    with scenes.running(case, pool) as app:
        app.world.comm = Forbidden()
        for _ in range(3):
            app.step()
    assert world.size == 1 and any("one rank sends no messages" in line for line in planned(case))


def counting(comm):
    """The same communicator, which counts what Python sends by channel."""
    from mpi4py import MPI

    class Counting(MPI.Intracomm):
        def Isend(self, buf, dest, tag=0):
            self.sent[Channel(tag % CHANNELS)] += 1
            return super().Isend(buf, dest, tag)

    made = Counting(comm)
    made.sent = Counter()
    return made


@pytest.fixture
def kept(monkeypatch):
    """Sends of all sets of messages that are made, by channel."""
    found, init = Counter(), Messages.__init__

    def counted(self, comm, *, sends=(), **more):
        init(self, comm, sends=sends, **more)
        found.update(Channel(min(message.channel, Channel.TRANSPOSE)) for message in sends)

    monkeypatch.setattr(Messages, "__init__", counted)
    return found


def numbers(case, ranks):
    """Messages of a step by the first word of their line of the plan."""
    lines = planned(case, ranks)
    lines = lines[lines.index("messages of a step, per rank") + 1 :]
    found = (re.match(r"  (\w+) +(\d+)", line) for line in lines)
    return {match[1]: int(match[2]) for match in found if match}


@pytest.mark.mpi(min_size=2)
def test_ranks_send_the_messages_that_are_planned(world, kept):  # C13
    pool, steps = Pool(1), 5
    spied = World(counting(world.comm), world.node)
    comm = spied.comm
    try:
        app = scenes.made(plasma(32 * world.size, 5000), pool, spied)
        plan = numbers(plasma(32 * world.size, 5000), world.size)
        assert kept[Channel.PARTICLES] == plan["particles"]
        assert kept[Channel.PARTICLES_WANTED] == plan["wanted"]
        app.step()  # letters grow to what is sent
        comm.sent.clear()
        for _ in range(steps):
            app.step()
        assert comm.sent.total() == 0
        assert kept[Channel.CHARGE] == plan["charge"]
        assert kept[Channel.POTENTIAL] == plan["potential"]
        assert kept[Channel.TRANSPOSE] == plan["transform"]
        potential, charge = app.mesh.fill, app.mesh.charge.fold
        text = "\n".join(planned(plasma(32 * world.size, 5000), world.size))
        for exchange in (potential, charge):
            assert f"together {exchange.bytes} bytes" in text
        app.close()

        kept.clear()
        app = scenes.made(flow((32, 32)), pool, spied)
        sent = kept[Channel.POPULATIONS_UP] + kept[Channel.POPULATIONS_DOWN]
        assert sent == 2 * numbers(flow((32, 32)), world.size)["populations"]
        app.close()
    finally:
        pool.close()


@pytest.mark.parametrize(
    "cases",
    [PLASMAS, WATERS, FLOWS, (plasma(256, 0), plasma(512, 0))],
    ids=["particles", "water", "lattice", "grid"],
)
def test_memory_grows_as_planned(held, cases):  # C14
    """The exponent of doubling one part of a scene is that of the plan."""
    measured, planned = (np.log2(size(cases[1]) / size(cases[0])) for size in (held, scenes.planned_bytes))
    assert measured == pytest.approx(planned, abs=0.1)
