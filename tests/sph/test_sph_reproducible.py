"""The bits of a run do not depend on ranks and threads, nor on where it was stopped and taken up again."""

import pytest
from app_runner import check_other_arrays_are_refused, check_same, running
from sph_scenes import layers, tank, text, torn

from hpcpic.core.comm.world import World
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

EXTRAPOLATED = """
wall = ( { name = "floor"; shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; }; },
         { name = "disc"; solid = true; motion = { amplitude = [0.02, 0.01]; period = 0.2; };
           shape = { sphere = { centre = [0.5, 0.25]; radius = 0.08; }; }; } );
gauge = ( { name = "bed"; what = "wall-pressure"; at = [0.98, 0.0]; axis = "y-"; size = [0.3, 0.0]; period = 0.004; } );
"""

AT_REST = EXTRAPOLATED.replace("motion = { amplitude = [0.02, 0.01]; period = 0.2; };", "")

BODIES = """
wall = ( { name = "raft"; solid = true; shape = { box = { low = [0.1, 0.3, 0.35]; high = [0.6, 0.7, 0.75]; }; };
           body = { density = 400.0; velocity = [-2.0, 0.0, 0.0]; angular_velocity = [1.0, 2.0, 3.0]; }; },
         { name = "ball"; solid = true; shape = { sphere = { centre = [1.0, 0.5, 0.3]; radius = 0.18; }; };
           body = { density = 2000.0; held = ["rx"]; }; } );
"""

CONTACTS = """
wall = ( { name = "tank"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.6]; open = ["y+"]; }; }; },
         { name = "a"; solid = true; shape = { box = { low = [0.3, 0.42]; high = [0.5, 0.54]; }; };
           body = { density = 600.0; velocity = [2.0, 0.0]; angular_velocity = [2.0];
                    mooring = ( { at = [0.3, 0.5]; anchor = [0.1, 0.6]; stiffness = 900.0; damping = 2.0; } ); }; },
         { name = "b"; solid = true; shape = { sphere = { centre = [0.66, 0.5]; radius = 0.1; }; };
           body = { density = 900.0; velocity = [-2.0, 0.0]; }; },
         { name = "flap"; solid = true; shape = { box = { low = [0.84, 0.2]; high = [0.92, 0.56]; }; };
           body = { density = 700.0; hinge = { point = [0.88, 0.56]; }; }; } );
"""

OPEN = """
wall = ( { name = "bed"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.6]; open = ["x-", "x+", "y+"]; }; }; } );
inlet = ( { low = [0.0, 0.0]; high = [0.12, 0.5]; axis = "x+"; discharge = 2.4; },
          { low = [0.4, 0.48]; high = [0.6, 0.6]; axis = "y-"; table = ( { time = 0.0; velocity = 8.0; } ); } );
outlet = ( { low = [0.88, 0.0]; high = [1.0, 0.5]; axis = "x+"; level = 0.4; waves = true; velocity = 6.0; } );
"""

SLIDING = """
wall = ( { name = "tank"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.6]; open = ["y+", "y-"]; }; }; },
         { name = "belt"; type = "pressure-continuity"; measure_force = true; motion = { velocity = [5.0, 0.0]; };
           shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; }; } );
"""

TURNING = """
wall = ( { name = "disc"; solid = true; shape = { sphere = { centre = [0.13, 0.3]; radius = 0.12; }; };
           type = "extrapolated-no-slip";
           body = { density = 900.0; velocity = [-3.0, 0.0]; angular_velocity = [20.0]; }; } );
"""

JOBS = {
    name: {"program": "sph", "case": case, "steps": 12}
    for name, case in {
        "layers": text(d=3, spacing=0.08, fill=(0.4, 1.0, 0.6), more=tank(3), balance=4),
        "stages": text(d=2, spacing=0.04, integrator="rk3-tvd", more=tank(2, "point-symmetric-free-slip")),
        "periodic": text(d=2, size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), periodic=("x",), form="cleary",
                         viscosity=1.0, precision="single", flux="rusanov", balance=3, velocity=(2.0, 0.0),
                         more=tank(2, "repulsive", (1.0, 0.6))),
        "extrapolated": text(d=2, size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), periodic=("x",), flux="delta",
                             balance=3, velocity=(2.0, 0.0), more=EXTRAPOLATED),
        "bodies": text(d=3, size=(1.4, 1.0, 1.0), spacing=0.1, fill=(1.4, 1.0, 0.6), periodic=("x", "y"), balance=3,
                       more=BODIES),
        "contacts": text(d=2, size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), flux="delta", balance=3, more=CONTACTS),
        "open": text(d=2, size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), flux="delta", balance=3, velocity=(6.0, 0.0),
                     form="full-stress", viscosity=1.0, alpha=0.0, shifting="true", more=OPEN),
        "liquids": layers(viscosities=(2.0, 0.5), size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), periodic=("x",),
                          form="morris", flux="delta", balance=3, velocity=(2.0, 0.0), more=EXTRAPOLATED),
        "gas": layers(densities=(1000.0, 2.0), ambient=1e4, size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.6),
                      flux="delta", periodic=("x",), balance=3, velocity=(2.0, 0.0), more=AT_REST),
        "sliding": text(d=2, size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), flux="delta", balance=3, more=SLIDING),
        "turning": layers(viscosities=(2.0, 0.5), size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), periodic=("x",),
                          form="morris", flux="delta", alpha=0.0, balance=3, more=TURNING),
        "torn": torn().replace("symplectic", "predictor-corrector"),
    }.items()
}  # fmt: skip


def test_same_bits_for_any_ranks_and_threads_and_after_restarts(tmp_path):
    """Parts of a run are taken up by more ranks, and by fewer with more threads."""
    two = {"threads": 2}
    jobs = {name: job for name, job in JOBS.items() if name != "liquids"}  # "turning" and "extrapolated" have its parts
    check_same(tmp_path, jobs, [(1, [{}], {}), (3, [], {}), (2, [two], two)])


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.validation] * (name == "liquids")) for name in JOBS]
)
def test_a_checkpoint_with_other_arrays_is_refused(tmp_path, name):
    with running(World.alone(), "sph", JOBS[name]["case"]) as app:
        check_other_arrays_are_refused(app, tmp_path)


def test_a_run_that_is_stopped_in_a_contact_goes_on_from_its_files(tmp_path):
    """Friction springs and impulses are in the files, which are held to their shapes, and count: without the springs
    the run ends otherwise.
    """
    rundir, found = RunDir(tmp_path / "run"), []
    (tmp_path / "run").mkdir()
    for part in ("whole", "taken up", "without springs"):
        with running(World.alone(), "sph", JOBS["contacts"]["case"]) as app:
            if part != "whole":
                reader = checkpoint.newest(rundir)
                checkpoint.hold(reader, app.columns(reader))
                app.restore(reader)
            else:
                for _ in range(8):
                    app.step()
                assert len(app.state()["ties/springs"].local) and app.scalars()["mooring_a_1"] > 0.0
                checkpoint.write(checkpoint.ALONE, rundir, app.iteration, app.time, app.state())
            if part == "without springs":
                app.bodies.ties.contacts.springs[:] = 0.0
            for _ in range(6):
                app.step()
            found.append((checkpoint.digest(World.alone(), app.state()), app.scalars()))
    assert found[1] == found[0] and found[2][0] != found[0][0]


@pytest.mark.validation
@pytest.mark.timeout(900)
def test_full_matrix(tmp_path):
    check_same(tmp_path, JOBS, [(ranks, [{}, {"threads": 2}], {}) for ranks in (1, 2, 3, 4)])
