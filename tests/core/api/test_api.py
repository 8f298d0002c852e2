"""The Python face: what is done in Python gives what the command line gives, and errors are exceptions."""

import copy
import dataclasses
import json
import pickle
import signal
import subprocess
import sys
import threading
from functools import partial

import numpy as np
import pytest
import xarray
from app_runner import launch
from seldom import seldom

import hpcpic
import lbmdem
import sph
from hpcpic.core.errors import ConfigError

SHORT = {"simulation.cycles": 12}


@pytest.fixture(scope="module")
def oscillation(tmp_path_factory):
    """A run of the plasma, made in Python."""
    case = hpcpic.Case("plasma-oscillation").changed(SHORT)
    return case.run(tmp_path_factory.mktemp("runs") / "oscillation", threads=1, quiet=True)


def test_import_loads_nothing_heavy():
    heavy = "{'numba', 'mpi4py', 'xarray', 'pydantic', 'numpy', 'h5py'}"
    code = f"import sys, hpcpic, sph, lbmdem; print(*({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_a_run_from_python_is_that_of_the_command_line(oscillation, tmp_path):
    words = ("-m", "hpcpic", "run", "plasma-oscillation", "--set", "simulation.cycles=12")
    done = launch(1, *words, "-o", str(tmp_path / "run"), "--threads", "1", "--quiet")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "run/run.json").read_text())["state_digest"] == oscillation.digest
    assert (tmp_path / "run/config.conf").read_text() == oscillation.case_text


def test_a_simulation_in_memory_ends_as_the_run(oscillation):
    with hpcpic.Case("plasma-oscillation").changed(SHORT).simulation(threads=2) as sim:
        sim.advance()
        assert sim.digest() == oscillation.digest
        last = oscillation.series.isel(time=-1)
        assert {name: float(last[name]) for name in last.data_vars} == sim.scalars()
        assert {type(value) for value in sim.scalars().values()} == {float}  # of Python, which prints as a number
        assert sim.fields("rho").equals(oscillation.fields("rho")) or np.array_equal(
            sim.fields("rho"), oscillation.fields("rho")
        )
        (name,) = oscillation.species
        assert sim.particles(name).equals(oscillation.particles(name))


WATER = sph.Case("water-column").changed({"numerics.spacing": 0.05})
CASES = [hpcpic.Case("plasma-oscillation").changed(SHORT), WATER, lbmdem.Case("settling-disc")]
NAMED = ["plasma", "water", "lattice"]


@pytest.mark.parametrize("case", CASES, ids=NAMED)
def test_a_simulation_tells_what_can_be_read_of_it(case):
    with case.simulation(threads=1) as sim:
        assert sim.species and (sim.field_names or case is WATER)
        for field in sim.field_names:
            assert sim.fields(field).size
        for species in sim.species:
            assert "position" in sim.particles(species)
    with pytest.raises(ConfigError, match="closed"):
        _ = sim.species


@pytest.mark.parametrize("case", CASES, ids=NAMED)
def test_what_cannot_change_a_simulation_is_refused(case):
    """And what has been read stays as it was when the simulation goes on."""
    with case.simulation(threads=1) as sim:
        sim.advance(steps=2)
        ends, digest = sim.model.end_time, sim.digest()
        found = [sim.particles(name)[column] for name in sim.model.particles() for column in ("position", "velocity")]
        found += [sim.fields(name) for name in sim.model.fields()]
        for values in found:
            with pytest.raises(ValueError, match="read-only"):
                values.values[...] = 1.0
            with pytest.raises(ValueError, match=r"\.copy\(\)"):  # in the words of xarray
                values[...] = 1.0
        own = found[0].copy(deep=True)
        own[...] = 1.0
        for name in ("time_step", "time", "gravity", "model", "end_time"):
            with pytest.raises(AttributeError, match=rf"{name}: a simulation goes on as its case says; case\.changed"):
                setattr(sim, name, 1.0)
        with pytest.raises(AttributeError, match=r"end_time: a configuration never changes; case\.changed"):
            case.config.simulation.end_time = 1.0
        with pytest.raises(AttributeError, match="config: a case never changes; changed"):
            case.config = None
        assert sim.digest() == digest and sim.model.end_time == ends
        before = [np.array(values) for values in found]
        sim.advance(steps=2)
        assert sim.digest() != digest
        assert all(np.array_equal(one, other) for one, other in zip(before, found, strict=True))


def test_ctrl_c_is_heard_after_a_whole_step():
    """The state is that of a simulation that was never interrupted."""
    with hpcpic.Case("plasma-oscillation").changed(SHORT).simulation(threads=1) as sim:

        @sim.every(steps=2)
        def interrupt(sim):
            if sim.iteration == 2:
                before = sim.model.advance
                sim.model.advance = lambda n: (signal.raise_signal(signal.SIGINT), before(n))

        with pytest.raises(KeyboardInterrupt):
            sim.advance()
        stopped, digest = sim.iteration, sim.digest()
    assert stopped > 2
    with hpcpic.Case("plasma-oscillation").changed(SHORT).simulation(threads=1) as sim:
        sim.advance(steps=stopped)
        assert sim.digest() == digest
    for use in (sim.step, sim.scalars, sim.digest, sim.particles):
        with pytest.raises(ConfigError, match="closed"):
            use()


def test_a_run_in_another_thread_hears_no_signals_and_ends(tmp_path):
    case, found = hpcpic.Case("plasma-oscillation").changed(SHORT), []
    thread = threading.Thread(target=lambda: found.append(case.run(tmp_path / "run", threads=1)))
    thread.start()
    thread.join()
    assert found[0].status == "finished"


def test_names_of_the_packages_are_shown():
    for package in (hpcpic, sph, lbmdem):
        assert {"Case", "Run", "cases", "open_run", "__version__"} <= set(dir(package))


def test_a_run_of_a_folder_names_what_opens_it(tmp_path):
    for package in (hpcpic, sph, lbmdem):
        with pytest.raises(ConfigError, match=r"opened by open_run\('folder'\)"):
            package.Run("folder")


def test_observers_see_each_multiple_once_and_change_nothing(oscillation):
    seen = {"steps": [], "seconds": []}
    with hpcpic.Case("plasma-oscillation").changed(SHORT).simulation(threads=1) as sim:
        sim.every(steps=5)(lambda sim: seen["steps"].append(sim.iteration))
        sim.every(seconds=0.5)(lambda sim: seen["seconds"].append(sim.time))
        sim.advance(steps=3)
        sim.advance(until=1.0)
        sim.advance()
        assert sim.digest() == oscillation.digest
    assert seen["steps"] == [0, 5, 10]
    assert np.allclose(seen["seconds"], [0.0, 0.6, 1.0, 1.6, 2.0])  # steps of 0.2 s


@pytest.mark.parametrize("call", [lambda sim: sim.step(), lambda sim: sim.advance(steps=1), lambda sim: sim.close()])
@pytest.mark.parametrize("case", CASES, ids=NAMED)
def test_an_observer_neither_steps_nor_closes(case, call):
    """What it tries is refused after a whole step, and the simulation goes on as if it had not been tried."""
    with case.simulation(threads=1) as sim, case.simulation(threads=1) as alone:
        tries = []

        @sim.every(steps=2)
        def meddle(sim):
            if sim.iteration == 2 and not tries:
                tries.append(sim.iteration)
                call(sim)

        with pytest.raises(ConfigError, match=r"called in an observer, which only looks: .* sim.advance\(steps=N\)"):
            sim.advance(steps=4)
        assert tries == [2] and sim.iteration == 2
        sim.advance(steps=2)
        alone.advance(steps=4)
        assert sim.digest() == alone.digest()


def test_series_has_units_and_makes_a_table(oscillation):
    assert oscillation.series["energy_field"].attrs["units"] == "J"
    table = oscillation.series.to_dataframe()
    assert table["energy_total"].mean() == pytest.approx(float(oscillation.series["energy_total"].mean()))
    assert list(table["step"]) == list(range(13))


def test_a_figure_comes_as_an_object(oscillation):
    assert oscillation.plot("energies").axes
    with pytest.raises(hpcpic.ConfigError, match="no figure 'nonsense'; there are energies"):
        oscillation.plot("nonsense")
    with pytest.raises(hpcpic.ConfigError, match=r"which figure\?; there are energies"):
        oscillation.plot()


def test_runs_are_compared(oscillation, tmp_path):
    alike = oscillation.compare(oscillation)
    assert alike.same_state and alike.beyond(0.0) == [] and all(one.max == 0.0 for one in alike.differences)
    case = hpcpic.Case("plasma-oscillation").changed({**SHORT, "simulation.cycles": 11})
    apart = oscillation.compare(case.run(tmp_path / "shorter", threads=1, quiet=True))
    assert not apart.same_state and [text for text in apart.beyond(0.0) if text.startswith("series: sampled at")]
    assert {one.what: one.max for one in apart.differences}["series energy_field"] == 0.0
    with pytest.raises(hpcpic.ConfigError, match=r"a run of hpcpic is compared with another one \(got 'runs/b'\)"):
        oscillation.compare("runs/b")


@pytest.mark.parametrize(
    ("when", "told"),
    [
        ({"time": "3"}, "time: a finite number"),
        ({"time": float("nan")}, "time: a finite number"),
        ({"step": 1.5}, "step: a whole number"),
        ({"step": 0, "time": 0.0}, "step=N or time=T"),
    ],
)
def test_snapshots_are_asked_for_by_a_step_or_a_time(oscillation, when, told):
    for read in (partial(oscillation.fields, "rho"), oscillation.particles):
        with pytest.raises(hpcpic.ConfigError, match=told):
            read(**when)


def test_snapshots_make_one_array_over_time(oscillation):
    """Fields and particles carry their time as a coordinate; as an attribute it was lost when they were joined."""
    fields = [oscillation.fields("E", time=t) for t in oscillation.field_times]
    film = xarray.concat(fields, "time", coords="different", compat="equals")
    assert film.time.values.tolist() == oscillation.field_times and film.step.values[-1] == 12
    assert float(oscillation.particles().time) == oscillation.particle_times[-1]


def test_a_run_goes_to_another_process_and_a_simulation_stays(oscillation):
    assert pickle.loads(pickle.dumps(oscillation)).digest == oscillation.digest
    with CASES[0].simulation(threads=1) as sim, pytest.raises(TypeError, match="neither pickled nor copied"):
        copy.deepcopy(sim)
    assert repr(sim) == "<simulation: 0 steps, t = 0 s, closed>"


def test_simulations_in_two_threads_are_those_of_one(oscillation):
    """Also where both make the kernels of a scene that the process has not seen."""
    script = """
import hpcpic
from concurrent.futures import ThreadPoolExecutor
case = hpcpic.Case("plasma-oscillation").changed({"simulation.cycles": 12})
def digest(_):
    with case.simulation(threads=1) as sim:
        sim.advance()
        return sim.digest()
with ThreadPoolExecutor(3) as pool:
    print(*set(pool.map(digest, range(6))))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.split() == [oscillation.digest], done.stderr


@pytest.mark.parametrize(
    ("when", "told"),
    [
        ({"steps": 2.5}, r"every: steps: a whole number, 1 or more \(got 2.5\)"),
        ({"steps": 0}, "every: steps: a whole number, 1 or more"),
        ({"steps": -3}, "every: steps: a whole number, 1 or more"),
        ({"steps": "3"}, "every: steps: a whole number, 1 or more"),
        ({"seconds": 0.0}, "every: seconds: greater than 0"),
        ({"seconds": -1}, "every: seconds: greater than 0"),
        ({"seconds": float("nan")}, "every: seconds: a finite number"),
        ({"seconds": "0.1"}, "every: seconds: a finite number"),
        ({}, "steps=N or seconds=T"),
        ({"steps": 1, "seconds": 0.1}, "steps=N or seconds=T"),
    ],
)
def test_observers_look_at_whole_steps_or_times_from_0_on(when, told):
    with (
        hpcpic.Case("plasma-oscillation").changed(SHORT).simulation(threads=1) as sim,
        pytest.raises(hpcpic.ConfigError, match=told),
    ):
        sim.every(**when)


@pytest.mark.parametrize("threads", [0, -1, 1.5, "2", True])
def test_threads_are_a_whole_number_from_one_on(threads, tmp_path):
    case = hpcpic.Case("plasma-oscillation")
    told = rf"threads: a whole number, 1 or more \(got {threads!r}\)"
    for take in (partial(case.run, tmp_path / "run"), case.simulation, case.estimate):
        with pytest.raises(hpcpic.ConfigError, match=told):
            take(threads=threads)
    assert not (tmp_path / "run").exists()


def test_an_advance_goes_to_a_time_or_by_steps_that_there_are():
    with hpcpic.Case("plasma-oscillation").changed(SHORT).simulation(threads=np.int64(1)) as sim:
        for goal in ({"until": float("nan")}, {"until": float("inf")}, {"until": "2"}, {"steps": -5}, {"steps": 2.5}):
            with pytest.raises(hpcpic.ConfigError, match=f"advance: {next(iter(goal))}: a .* number"):
                sim.advance(**goal)
        sim.advance(steps=np.int64(2))
        sim.advance(steps=0)
        assert sim.iteration == 2


@pytest.mark.parametrize("case", [hpcpic.Case("plasma-oscillation"), WATER])
def test_a_time_that_is_past_is_refused(case):
    with case.simulation(threads=1) as sim:
        sim.advance(until=0.0)
        sim.advance(steps=3)
        now, step = sim.time, sim.time / 3
        for past in (now - 1.5 * step, -step):
            with pytest.raises(hpcpic.ConfigError, match=r"advance: until: the simulation is at .* s already"):
                sim.advance(until=past)
        sim.advance(until=now)
        sim.advance(until=now - 0.5 * step)  # the first step at or after it is this one
        assert sim.iteration == 3


def test_steps_and_times_go_past_the_end_of_the_case():
    with hpcpic.Case("plasma-oscillation").changed(SHORT).simulation(threads=1) as sim:
        sim.advance()
        sim.step()
        sim.advance()
        assert sim.iteration == 13
        sim.advance(until=sim.time * 15 / 13)
        assert sim.iteration == 15


def test_particles_in_memory_have_all_digits_of_the_state(tmp_path):
    """They have the energy of the series, which is summed of the state; files of SPH hold them rounded."""
    case = sph.Case("water-column").changed({"numerics.spacing": 0.05, "simulation.end_time": 0.002})
    with case.simulation(threads=1) as sim:
        sim.advance()
        water, scalars = sim.particles("water"), sim.scalars()
    energy = float((water["mass"] * (water["velocity"] ** 2).sum("component")).sum()) / 2
    assert energy == pytest.approx(scalars["energy_kinetic"], rel=1e-12)
    kept = case.run(tmp_path / "run", threads=1, quiet=True).particles("water")
    assert kept["position"].equals(water["position"])
    assert sph.open_run(tmp_path / "run").field_names == () and sph.open_run(tmp_path / "run").field_times == []
    with pytest.raises(hpcpic.FileError, match="has no snapshots of fields"):
        sph.open_run(tmp_path / "run").fields("pressure")
    for name in ("velocity", "pressure", "density", "mass"):
        assert kept[name].dtype == np.float32 and np.array_equal(kept[name], water[name].astype(np.float32))


@pytest.mark.parametrize(
    ("program", "case", "end", "setting"),
    [
        (hpcpic, "plasma-oscillation", SHORT, "every.particles"),
        (sph, "water-column", {"numerics.spacing": 0.05, "simulation.end_time": 0.002}, "period.particles"),
        (lbmdem, "settling-disc", {"simulation.end_time": 1e-3}, "period.grains"),
    ],
)
def test_a_run_without_snapshots_names_the_setting_that_asks_for_them(program, case, end, setting, tmp_path):
    run = program.Case(case).changed({**end, f"output.{setting}": 0}).run(tmp_path / "run", threads=1, quiet=True)
    with pytest.raises(hpcpic.FileError, match=rf"has no snapshots of particles; output\.{setting} asks for them"):
        run.particles("electrons")


def test_wall_and_checkpoints_are_taken_as_numbers_too(tmp_path):
    case = hpcpic.Case("plasma-oscillation").changed(SHORT)
    run = case.run(tmp_path / "run", threads=1, wall=600, checkpoint_every=5, quiet=True)
    assert run.status == "finished" and (run.path / "checkpoints/00000010.h5").exists()
    for wrong in ({"wall": -60.0}, {"wall": "soon"}, {"checkpoint_every": 2.5}):
        with pytest.raises(hpcpic.ConfigError, match="is no"):
            case.run(tmp_path / "other", threads=1, quiet=True, **wrong)
    assert not (tmp_path / "other").exists()


def test_limits_bind_in_python_too(tmp_path):
    case = hpcpic.Case("plasma-oscillation").changed({"simulation.time_step": 100.0})
    assert not case.check().ok
    assert case.check()["wp dt"].verdict == "fail"
    assert [row.symbol for row in case.check() if row.verdict == "fail"] == ["wp dt"]
    with pytest.raises(hpcpic.ConfigError, match=r"limit < 1\.2, stable below 2"):
        case.run(tmp_path / "run")
    with pytest.raises(hpcpic.ConfigError, match=r"limit < 1\.2, stable below 2"):
        case.simulation()
    assert not (tmp_path / "run").exists()


def test_a_folder_that_holds_a_run_is_a_file_error(oscillation):
    with pytest.raises(hpcpic.FileError, match="holds a run already"):
        hpcpic.Case("plasma-oscillation").changed(SHORT).run(oscillation.path)
    with pytest.raises(hpcpic.FileError, match="a run of hpcpic"):
        lbmdem.open_run(oscillation.path)


def cut_off(case, folder, **flags):
    """A run whose last checkpoint is lost, as one that was killed between its checkpoints."""
    run = case.run(folder, threads=1, quiet=True, checkpoint_every=5, **flags)
    max((run.path / "checkpoints").iterdir()).unlink()
    return run


def test_a_finished_run_is_found_to_be_so_before_a_model_is_made(oscillation, tmp_path, capfd):
    """And an end that its checkpoint is beyond is refused before, too."""
    sphs = sph.Case("water-column").changed({"numerics.spacing": 0.05, "simulation.end_time": 0.01})
    dry = lbmdem.Case("restitution").changed({"simulation.end_time": 0.001})
    runs = [oscillation, *(case.run(tmp_path / str(i), threads=1, quiet=True) for i, case in enumerate((sphs, dry)))]
    capfd.readouterr()
    for made in runs:
        run = type(made).open(made.path, dataclasses.replace(made._app, load=lambda: pytest.fail("a model is made")))
        assert run.restart(threads=1).digest == made.digest
        assert "nothing to do: the run has finished" in capfd.readouterr().out
        with pytest.raises(ConfigError, match="beyond the end asked for"):
            run.restart(threads=1, until=float(run.series.time[-1]) / 10)


@pytest.mark.parametrize("ranks", [seldom(1), 2])
def test_a_restart_in_python_ends_as_the_run_that_nobody_interrupted(oscillation, tmp_path, ranks):
    cut_off(hpcpic.Case("plasma-oscillation").changed(SHORT), tmp_path / "run")
    script = tmp_path / "again.py"
    script.write_text(f"""import hpcpic
run = hpcpic.open_run({str(tmp_path / "run")!r})
with run.simulation(threads=1) as sim:
    assert sim.iteration == 10
    sim.advance()
    assert sim.digest() == {oscillation.digest!r}
assert run.restart(threads=1, quiet=True).digest == {oscillation.digest!r}
""")
    done = launch(ranks, "-m", "mpi4py", str(script))
    assert done.returncode == 0, done.stderr
    again = hpcpic.open_run(tmp_path / "run")
    assert again.summary["history"][-1]["first_step"] == 10
    assert again.series.equals(oscillation.series)


def test_a_restart_in_python_may_go_on_farther_and_changes_nothing_else(oscillation, tmp_path):
    run = cut_off(hpcpic.Case("plasma-oscillation").changed({"simulation.cycles": 6}), tmp_path / "run")
    for wrong, told in (
        ({"changes": {"grid.points": [3]}}, "a restart cannot change grid.points; it can change description"),
        ({"changes": {"grid": {"points": [3]}}}, "a restart cannot change grid.points; it can change description"),
        ({"changes": {"species[0].start": {"position": [1.0]}}}, "goes on from a checkpoint"),
        ({"until": -1.0}, "until -1: must be a time in s after the start"),
        ({"until": "3"}, "until: a finite number"),
        ({"until": 0.2}, "beyond the end asked for"),
        ({"threads": 0}, "threads: a whole number"),
        ({"wall": "soon"}, "is not a duration"),
    ):
        with pytest.raises(hpcpic.ConfigError, match=told):
            run.restart(quiet=True, **wrong)
    assert run.restart({"simulation": {"cycles": 12}}, threads=1, quiet=True).digest == oscillation.digest
    for checkpoint in (run.path / "checkpoints").iterdir():
        checkpoint.unlink()
    for use in (run.restart, run.simulation):
        with pytest.raises(hpcpic.FileError, match="no checkpoint"):
            use(threads=1)


@pytest.mark.parametrize("case", [hpcpic.Case("plasma-oscillation"), sph.Case("still-tank"), lbmdem.Case("poiseuille")])
def test_a_simulation_tells_how_long_its_steps_are(case):
    with case.simulation(threads=1) as sim:
        for _ in range(2):
            before = sim.time
            sim.step()
            assert sim.time - before == pytest.approx(sim.time_step, rel=1e-12) and sim.time_step > 0.0
