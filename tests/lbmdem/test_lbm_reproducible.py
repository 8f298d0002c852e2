"""One state, bit for bit, however a run is cut: ranks, threads, task blocks, restarts on others of them.

Grains touch, cross the seam and the cuts between slabs, cover and uncover nodes.
"""

import math
import re
from itertools import product

import numpy as np
import pytest
from app_runner import check_other_arrays_are_refused, check_same, running

from hpcpic.core.case import accelerations
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

VORTICES = """
simulation = { end_time = 1.0; };
domain = { size = [0.037, 0.023]; spacing = 0.001; periodic = ["x", "y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.6; initial = { flow = "shear-layer"; speed = 1.0e-3; };
          body_force = [1e-5, 2e-5]; };
"""
DUCT = """
simulation = { end_time = 1.0; };
domain = { size = [0.019, 0.009, 0.013]; spacing = 0.001; periodic = ["y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [1e-5, 2e-5, 0.0]; };
boundary = ({ face = "x-"; type = "velocity"; velocity = [1.0e-4, 0.0, 0.0]; },
            { face = "x+"; type = "pressure"; pressure = 0.0; },
            { face = "z+"; type = "wall"; velocity = [1.0e-4, 1.0e-4, 0.0]; });
"""
DISCS = """
simulation = { end_time = 1.0; };
domain = { size = [0.0048, 0.006]; spacing = 0.0002; periodic = ["x"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [0.3, 0.1]; };
grains = (
  { diameter = 1.2e-3; density = 2650.0; velocity = [4.0e-3, -3.0e-3]; angular_velocity = [1.0];
    position = ([0.00475, 0.00302], [0.0036, 0.0032], [0.0030, 0.00415]); },
  { diameter = 1.0e-3; density = 300.0; position = [0.0041, 0.00201]; },
  { diameter = 1.6e-3; moving = false; position = [0.0017, 0.0021]; } );
contact = { normal_stiffness = 50.0; damping = 0.3; tangential = "history"; friction = 0.4; };
gravity = [0.0, -0.02];
"""
SPHERES = """
simulation = { end_time = 1.0; };
domain = { size = [0.0026, 0.0022, 0.0028]; spacing = 0.0002; periodic = ["x", "y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; };
grains = (
  { diameter = 1.0e-3; density = 2650.0; velocity = [3.0e-3, 2.0e-3, -4.0e-3]; angular_velocity = [1.0, 0.5, 0.2];
    position = ([0.00255, 0.0011, 0.00145], [0.00156, 0.0011, 0.00145]); },
  { diameter = 0.9e-3; density = 2000.0; velocity = [0.0, 0.0, 1.0e-2]; position = [0.0012, 0.0011, 0.00058]; } );
contact = { normal_stiffness = 0.02; damping = 0.3; tangential = "history"; friction = 0.4; };
gravity = [0.0, 0.0, -0.02];
"""
BED = """
simulation = { end_time = 1.0; };
domain = { size = [0.0026, 0.0022, 0.0028]; spacing = 0.0002; periodic = ["x", "y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [1e-3, 2e-3, 0.0]; };
boundary = ({ face = "z-"; type = "pressure"; pressure = 0.02; pressure_rate = 1.0; },
            { face = "z+"; type = "pressure"; pressure = 0.0; });
grains = ({ diameter = 1.0e-3; density = 2650.0; position = (
  [0.0005, 0.0006, 0.000499], [0.0015, 0.0006, 0.0005], [0.001, 0.0014, 0.00051], [0.001, 0.0009, 0.00132]); });
contact = { normal_stiffness = 0.5; damping = 0.3; tangential = "history"; friction = 0.4; };
coupling = { frozen = true; };
gravity = [0.0, 0.0, -0.2];
output = { stress_slices = 3; };
"""
CORNER = """
simulation = { end_time = 1.0; };
domain = { size = [0.009, 0.011, 0.013]; spacing = 0.001; periodic = ["x", "y", "z"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [1e-5, 2e-5, 3e-5]; };
obstacle = ({ shape = { box = { low = [-0.002, 0.0, 0.0]; high = [0.0023, 0.0041, 0.0062]; }; }; });
"""
WALLED = """
obstacle = ({ name = "bed"; shape = { plane = { point = [0.0, 0.0006]; normal = [0.0, 1.0]; }; }; });
"""
NARROW = "domain.size=[0.002, 0.002, 0.0022]"  # little fluid is left: its solid nodes are not held
FIXED = (NARROW, "grains[0].moving=false", "boundary[0].pressure_rate=0.0")
REFILLS = "average", "local", "non-equilibrium", "mass-conserving", "conserving"
STEPS = 21


def job(case: str, *sets: str) -> dict:
    return {"program": "lbmdem", "case": case, "sets": list(sets), "threads": 1, "steps": STEPS}


LAWS = {
    "2D": job(VORTICES),
    "2D BGK single": job(VORTICES, 'fluid.storage="single"', 'fluid.collision="BGK"'),
    "2D central": job(VORTICES, 'fluid.collision="central"'),
    "3D": job(DUCT),
    "3D single": job(DUCT, 'fluid.storage="single"'),
    "3D central single": job(DUCT, 'fluid.storage="single"', 'fluid.collision="central"'),
    **{f"discs {name}": job(DISCS, f'coupling.refill="{name}"') for name in REFILLS},
    "discs explicit": job(DISCS, 'coupling.inertia="explicit"', 'contact.tangential="regularised"'),
    "discs shaken": job(DISCS, "shaking.acceleration=[0.5, 0.2]", "shaking.frequency=20.0"),
    "spheres": job(SPHERES),
    "bed seen at rest": job(BED),
    "narrow bed": job(BED, NARROW),
    "corner": job(CORNER),
    "fixed bed": job(BED, *FIXED, "output.stress_slices=0"),
}


# In validation alone. Refills on ranks: see test_coupling, those that owe mass also test_refill; collisions know no
# ranks; a fluid alone in 2D: see test_fluid.
REST = {"discs average", "discs non-equilibrium", "discs mass-conserving", "2D", "2D BGK single", "2D central", "3D",
        "3D central single"}  # fmt: skip


def cut(threads, blocks):
    return {"threads": threads, "sets": [f"simulation.blocks={blocks}"]}


@pytest.mark.timeout(300)  # it may have to compile a minute's worth of kernels
def test_ranks_threads_blocks_and_restarts(tmp_path):
    """Restarts after an odd and an even number of steps: the places of the populations differ. Two ranks are first, as
    they compile together; three go on with what they did: more ranks than cores take twice as long.
    """
    launches = [(2, [cut(2, 3)], cut(1, 1)), (3, [], cut(1, 2)), (1, [cut(1, 1)], cut(2, 2))]
    check_same(tmp_path, {law: job for law, job in LAWS.items() if law not in REST}, launches)


@pytest.mark.validation
@pytest.mark.timeout(900)
@pytest.mark.parametrize("law", LAWS)
def test_full_matrix(tmp_path, law):
    every = [cut(*one) for one in product((1, 2), (1, 4, 9))]
    check_same(tmp_path, {law: LAWS[law]}, [(ranks, every, cut(1, ranks)) for ranks in (1, 2, 3, 4)])


@pytest.mark.parametrize("name", ["fixed bed", "bed seen at rest", "corner", "walled discs"])
def test_the_first_sample_after_a_restart_is_that_of_the_whole_run(tmp_path, world, name):
    """Forces are means of two steps, of which one was before."""
    one = (LAWS | {"walled discs": job(DISCS + WALLED)})[name]
    rundir, found = RunDir(tmp_path), []
    for steps in (5, 1):
        with running(world, "lbmdem", one["case"], one["sets"]) as app:
            if steps == 1:
                app.restore(checkpoint.newest(rundir, world))
            for _ in range(steps):
                app.step()
            if steps == 5:
                checkpoint.write(world, rundir, app.iteration, app.time, app.state())
                app.step()
            found.append(app.scalars())
    assert found[0] == found[1]
    assert any(value for key, value in found[0].items() if key.startswith("force_"))


def swirl(x, v, t):
    return 60.0 * (x[1] - 0.003) - 2.0 * v[0], 60.0 * (0.002 - x[0]) + 0.3 * math.sin(90.0 * t), 0.0


@pytest.mark.parametrize("dry", [False, True])
def test_a_restart_under_an_acceleration_of_ones_own_has_the_same_bits(tmp_path, world, monkeypatch, dry):
    monkeypatch.setitem(accelerations.ACCELERATIONS, "swirl", swirl)
    case = re.sub("fluid = {.*};", "", DISCS) if dry else DISCS
    rundir, found = RunDir(tmp_path), []
    for steps in (9, 4):
        with running(world, "lbmdem", case, ['grains[0].acceleration="swirl"']) as app:
            if steps == 4:
                app.restore(checkpoint.newest(rundir, world))
            for left in reversed(range(steps)):
                app.step()
                if steps == 9 and left == 4:
                    checkpoint.write(world, rundir, app.iteration, app.time, app.state())
            found.append(checkpoint.digest(world, app.state()))
    assert found[0] == found[1]


@pytest.mark.parametrize("case", [DISCS, SPHERES, BED], ids=["discs", "spheres", "bed"])
def test_a_checkpoint_with_other_arrays_is_refused(tmp_path, world, case):
    with running(world, "lbmdem", case) as app:
        fixed = ("grains/mass", "grains/inertia", "grains/row") if app.dem else ()
        check_other_arrays_are_refused(app, tmp_path, *fixed)


def test_a_grain_of_another_mass_or_size_or_without_energy_ends_the_run(world):
    """No step changes the first: the memory is damaged, by the least that a bit can do. On heat and work nothing that
    moves depends.
    """
    constants = [("mass", ()), ("inertia", ()), ("pull", ()), ("row", (3,)), ("row", (7,)), ("row", (11,))]
    constants += [("row", (6,)), ("row", (8,)), ("row", (9,))]  # discs stay in their plane
    with running(world, "lbmdem", DISCS) as app:
        app.step()
        for column, word in (*constants, ("heat", ()), ("work", ())):
            assert app.guard() is None
            values, at = app.dem.grains.columns[column], (1, *word)
            kept, constant = values[at], (column, word) in constants
            values[at] = np.nextafter(kept, 2.0) if constant else np.nan
            assert ("damaged memory" if constant else "energy of a grain is no number") in app.guard()
            values[at] = kept
