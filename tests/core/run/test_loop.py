"""The loop around the toy, in this process; tests/cli runs it from outside."""

import io
import json
import logging
import time

import pytest
from toy_app import Toy, ToyConfig

from hpcpic.core.comm.world import World
from hpcpic.core.files import image
from hpcpic.core.files.reader import open_run
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import read_series
from hpcpic.core.run import checkpoint, loop, summary
from hpcpic.core.run.signals import Reason, Stop, WallLimit
from hpcpic.core.run.triggers import Every, EverySeconds, EveryTime
from hpcpic.core.timers import Timers


class Runner:
    def __init__(self, world, folder):
        self.world, self.folder = world, folder

    def __call__(self, name="a", reader=None, hook=None, checkpoint_every=None, **settings):
        """Outcome and app of a run; `hook(app, stop)` is called at the beginning of every step."""
        world = self.world
        rundir = RunDir(self.folder / name)
        if world.rank == 0 and reader is None:
            rundir = RunDir.create(rundir.path, config="")
        world.barrier()
        timers = Timers()
        stop = Stop(lambda sentence: None)
        app = Toy(ToyConfig(**settings), world, None, timers)
        if reader:
            app.restore(reader)
        if hook:
            plain = app.step

            def step():
                hook(app, stop)
                plain()

            app.step = step
        options = loop.Options(stop, WallLimit(None, time.monotonic()), timers, 1, io.StringIO())
        options.checkpoint_every = checkpoint_every or options.checkpoint_every
        options.restarted_from = reader.step if reader else None
        try:
            return loop.run(app, world, rundir, options), app
        finally:
            stop.close()
            rundir.unlock()


@pytest.fixture
def runner(tmp_path):
    return shared_runner(tmp_path)


def shared_runner(tmp_path):
    """All ranks in the folder of rank 0."""
    world = World.start()
    return Runner(world, type(tmp_path)(world.bcast(str(tmp_path).encode()).decode()))


def steps_of(runner, name="a"):
    return sorted(int(path.stem) for path in (runner.folder / name / "checkpoints").glob("*"))


@pytest.mark.parametrize("kind", ["openpmd", "checkpoints"])
def test_what_is_moved_while_it_is_written_is_written_again(runner, monkeypatch, kind):
    here, there, write = runner.folder / "a", runner.folder / "b", image.write_shards

    def moved(path, slots, shards):
        write(path, slots, shards)
        if path.parent.name == kind and here.exists():
            here.rename(there)

    monkeypatch.setattr(image, "write_shards", moved)
    outcome, _ = runner(steps=20, output={"openpmd": 10})
    assert outcome.exit_code == 0 and not here.exists() and steps_of(runner, "b") == [20]
    names = [f"data{step:08d}.h5" for step in (0, 10, 20)]
    assert sorted(path.name for path in (there / "openpmd").iterdir()) == names
    assert outcome.facts["folder"] == str(there) and not [*there.glob("trace-*")]


def test_series_at_its_period_and_at_the_end(runner):
    outcome, _ = runner(steps=25, output={"series": 10})
    assert outcome.exit_code == 0
    assert read_series(runner.folder / "a").step.tolist() == [0, 10, 20, 25]


def test_the_series_has_what_snapshots_and_checkpoints_show(runner):
    """At every moment at which the run may be killed, from the first step on."""
    seen = []

    def look(app, stop):
        run = open_run(runner.folder / "a")
        there = set(run.series.step.tolist())
        shown = {*run.field_snapshots.steps.tolist(), *run.particle_snapshots.steps.tolist(), *steps_of(runner)}
        assert shown and shown <= there, (shown, there)
        seen.append(max(shown))

    outputs = {"series": 1, "field": 5, "particle": 7}
    outcome, _ = runner(steps=60, hook=look, pause=0.005, output=outputs, checkpoint_every=Every(8))
    assert outcome.exit_code == 0 and len(seen) == 60 and seen[-1] >= 56


def test_checkpoints_by_steps_keep_two_and_the_end_is_always_there(runner):
    runner(steps=25, checkpoint_every=Every(10))
    assert steps_of(runner) == [20, 25]


def test_the_state_at_the_end_is_put_in_order_once(runner):
    states = []

    def watch(app, stop):
        if not states:
            plain, app.state = app.state, lambda: states.append(app.iteration) or plain()
            states.append(None)

    outcome, app = runner(steps=5, hook=watch)
    assert states == [None, 5]
    assert outcome.facts["state_digest"] == checkpoint.digest(app.world, app.state())


def test_what_is_compiled_after_the_last_step_is_not_taken_off_the_steps(runner):
    """The state at the end wants kernels of its own: a short run was said to do 0 steps a second."""

    def compile_later(app, stop):
        plain = type(app).state

        def state():
            with app.timers.section("compiling"):
                time.sleep(0.2)
            return plain(app)

        app.state = state

    outcome, _ = runner(steps=5, pause=0.002, hook=compile_later)
    assert outcome.facts["timers"]["compiling"]["avg"] > 0.2 > outcome.facts["loop_seconds"]
    assert summary.stepping_seconds(outcome.facts) == outcome.facts["loop_seconds"] > 0.01


def test_checkpoints_by_time(runner):
    runner(steps=40, pause=0.005, checkpoint_every=EverySeconds(0.02))
    assert steps_of(runner)[-1] == 40 and 0 < steps_of(runner)[0] < 40


def test_a_reason_stops_after_the_step_that_heard_it(runner):
    def at_ten(app, stop):
        if app.iteration == 10:
            stop.reason = Reason.SIGTERM

    outcome, app = runner(steps=1000, pause=0.005, hook=at_ten)
    # 0.2 s of 5 ms steps at most until it is agreed on
    assert outcome.exit_code == 5 and 11 <= app.iteration <= 60
    assert steps_of(runner)[-1] == app.iteration
    assert json.loads((runner.folder / "a/run.json").read_text())["status"] == "stopped"


def test_nothing_that_has_diverged_reaches_a_checkpoint(runner):
    def poison(app, stop):
        if app.iteration == 17:
            app.u[0] = float("inf")

    outcome, _ = runner(steps=100, hook=poison, checkpoint_every=Every(5))
    assert outcome.exit_code == 4 and outcome.status == "diverged"
    assert steps_of(runner) == [10, 15]


def check_restart_is_no_change(runner):
    whole, _ = runner("whole", steps=30)
    runner("parts", steps=18)
    rundir = RunDir(runner.folder / "parts")
    reader = checkpoint.newest(rundir, runner.world)
    parts, _ = runner("parts", reader=reader, steps=30)
    assert parts.exit_code == 0
    assert parts.facts["state_digest"] == whole.facts["state_digest"]
    if runner.world.rank == 0:
        series = [read_series(runner.folder / name) for name in ("parts", "whole")]
        assert series[0].step.tolist() == series[1].step.tolist()
        assert series[0]["mass"].tolist() == series[1]["mass"].tolist()


def test_run_and_restart_is_the_run(runner):
    check_restart_is_no_change(runner)


@pytest.mark.mpi(min_size=2)
def test_run_and_restart_is_the_run_on_many_ranks(tmp_path):
    check_restart_is_no_change(shared_runner(tmp_path))


@pytest.mark.mpi(min_size=2)
def test_a_reason_on_one_rank_stops_all_at_one_step(tmp_path):
    runner = shared_runner(tmp_path)

    def at_ten(app, stop):
        if app.iteration == 10 and runner.world.rank == runner.world.size - 1:
            stop.reason = Reason.SIGUSR1

    outcome, app = runner(steps=1000, pause=0.002, hook=at_ten)
    assert outcome.exit_code == 5
    assert runner.world.max(app.iteration) == -runner.world.max(-app.iteration)


@pytest.mark.mpi(min_size=2)
def test_divergence_of_one_rank_is_the_outcome_of_all(tmp_path):
    runner = shared_runner(tmp_path)
    last = runner.world.size - 1

    def poison(app, stop):
        if app.iteration == 5 and runner.world.rank == last:
            app.u[0] = float("nan")

    outcome, _ = runner(steps=50, hook=poison)
    assert outcome.exit_code == 4 and f"rank {last}" in outcome.reason


def test_the_screen_shows_nothing_of_a_short_run_and_the_log_its_beginning(runner, caplog):
    logging.getLogger("hpcpic").propagate = True
    with caplog.at_level(logging.INFO, "hpcpic"):
        runner(steps=3)
    assert "steps 0 to 3 on 1 rank x 1 thread" in caplog.text


class Timed(Toy):
    """Does not know its number of steps: it ends at time 2.5, and each step takes 0.1."""

    def __init__(self, *rest):
        super().__init__(*rest)
        self.n_steps, self.end_time, self.time_step = None, 2.5, 0.1
        self.periods, self.time_periods = {}, {"series": 0.5}


def test_a_run_by_time_ends_and_samples_at_the_first_step_at_or_after(runner, monkeypatch):
    monkeypatch.setitem(globals(), "Toy", Timed)
    outcome, app = runner(steps=1, checkpoint_every=EveryTime(1.0, since=0.0))
    assert (outcome.exit_code, app.iteration) == (0, 25)
    assert read_series(runner.folder / "a").step.tolist() == [0, 5, 10, 15, 20, 25]
    assert steps_of(runner) == [20, 25]
