"""Small runs of any simulator for tests, in processes of their own, many per launch.

`mpirun -n R python app_runner.py JOBS.json` makes every job of a list, on its R ranks or on the first of them; rank 0
prints what came out as one line of JSON. A job is a dict: program, case (text), sets, threads, steps, and optionally
`ranks` (how many), `save` (folder for a checkpoint at the end) or `resume` (folder to go on from).
"""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby, product
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
MPIRUN = Path(sys.executable).with_name("mpirun")
LAUNCHER_KEYS = ("PMI", "OMPI", "PMIX", "MPI", "HYDI")
USER_KEYS = ("OMPI_ALLOW",)  # which Open MPI wants from root
TIMEOUT_S = 300  # compilation of all kernels included


@contextmanager
def running(world: Any, program: str, case: Any, sets: Sequence[str] = (), threads: int = 1) -> Iterator[Any]:
    """A simulator at its initial state, of the text of a case or of the configuration itself."""
    from hpcpic.core.case.config import loads
    from hpcpic.core.tasks.graph import Pool
    from hpcpic.core.timers import Timers

    app = importlib.import_module(f"{program}.__main__").load_app()
    config = app.configure(loads(case, sets=sets)) if isinstance(case, str) else case
    pool = Pool(threads, world.cpus(threads))
    try:
        made = app.load()(config, world, pool, Timers())
        yield made
        made.close()
    finally:
        pool.close()


def outcome(world: Any, job: Mapping[str, Any]) -> dict[str, Any]:
    """Digest of the state at the end, and the scalars bit for bit."""
    from hpcpic.core.files.rundir import RunDir
    from hpcpic.core.run import checkpoint

    with running(world, job["program"], job["case"], job.get("sets", ()), job.get("threads", 1)) as app:
        if "resume" in job:
            reader = checkpoint.newest(RunDir(job["resume"]), world)
            checkpoint.hold(reader, app.columns(reader), world)
            app.restore(reader)
        while app.iteration < job["steps"]:
            app.step()
        if "save" in job:
            checkpoint.write(world, RunDir(job["save"]), app.iteration, app.time, app.state())
        scalars = app.scalars()
        digest = checkpoint.digest(world, app.state())
    return {"digest": digest, "scalars": {name: float(value).hex() for name, value in scalars.items()}}


def check_other_arrays_are_refused(app: Any, folder: Path, *fixed: str) -> None:
    """The state of an app on one rank is one of its scene; another with one array otherwise is not, and is told by its
    name. fixed: arrays that no step changes.
    """
    import numpy as np
    import pytest

    from hpcpic.core.errors import FileError
    from hpcpic.core.files.rundir import RunDir
    from hpcpic.core.run import checkpoint

    def held(arrays: Mapping[str, Any]) -> Mapping[str, Any]:
        rundir = RunDir(folder)
        shards = {name: checkpoint.Shard(array, 0, len(array)) for name, array in arrays.items()}
        checkpoint.write(checkpoint.ALONE, rundir, app.iteration, app.time, shards)
        reader = checkpoint.newest(rundir)
        columns = app.columns(reader)
        checkpoint.hold(reader, columns)
        return columns

    state = {name: shard.local for name, shard in app.state().items()}
    columns = held(state)
    for name, array in state.items():
        told = "x|number" if name == "number" else re.escape(name.partition("/")[0])  # one of arrays of one length
        others = [array[..., None], array.astype("f4" if array.dtype == "f8" else "f8")]
        others += [np.concatenate([array, array])] if array.size else []
        finite = array.dtype.kind == "f" and array.size and not columns[name].open
        others += [np.full_like(array, value) for value in (np.nan, np.finfo(array.dtype).max)] if finite else []
        others += [2 * array] if name in fixed else []
        for other in others:
            with pytest.raises(FileError, match=told):
                held(state | {name: other})
        with pytest.raises(FileError, match=told):
            held({key: kept for key, kept in state.items() if key != name})
    with pytest.raises(FileError, match="strange: this scene has no such array"):
        held(state | {"strange": np.zeros(2)})


def environment(**extra: str) -> dict[str, str]:
    """Without what a launcher above pytest has set: it would be taken for ours."""
    kept = (key for key in os.environ if key.startswith(USER_KEYS) or not key.startswith(LAUNCHER_KEYS))
    return {key: os.environ[key] for key in kept} | {"PYTHONPATH": str(ROOT)} | extra


def launch(ranks: int, *words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """A Python command line on so many ranks, to the end; on one without a launcher."""
    launcher = [str(MPIRUN), "-n", str(ranks)] if ranks > 1 else []
    command = [*launcher, sys.executable, *words]
    return subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=TIMEOUT_S, **options)


def outcomes(folder: Path, ranks: int, jobs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Of jobs made one after the other by one launch on so many ranks."""
    told = folder / f"jobs-{ranks}.json"
    told.write_text(json.dumps(list(jobs)))
    done = launch(ranks, __file__, str(told))
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


Launch = tuple[int, Sequence[Mapping[str, Any]], Mapping[str, Any] | None]


def check_same(folder: Path, jobs: Mapping[str, Mapping[str, Any]], launches: Sequence[Launch]) -> None:
    """Every job ends with the same digest and scalars in all launches.

    A launch = (ranks, changes (threads, sets) of whole runs, change of the next part of a run that goes on from where
    the launch before has left it, if any): all parts together are one more run. One program makes them all, on as many
    of its ranks as each wants: kernels are read and libraries imported once a rank.
    """
    asked: list[tuple[str, str, dict[str, Any]]] = []
    parts, k = sum(part is not None for *_, part in launches), 0
    for ranks, changes, part in launches:
        on = {"ranks": ranks}
        for (name, job), one in product(jobs.items(), changes):
            asked.append((name, f"{ranks} ranks, {one}", {**job, **changed(job, one), **on}))
        if part is not None:
            k += 1
            for name, job in jobs.items():
                asked.append((name, f"part {k}", part_of(folder, name, job, part, k, parts) | on))
    made = outcomes(folder, max(ranks for ranks, *_ in launches), [job for *_, job in asked])
    found: dict[str, dict[str, Any]] = {name: {} for name in jobs}
    for (name, cut, job), one in zip(asked, made, strict=True):
        if job["steps"] == jobs[name]["steps"]:
            found[name][cut] = one
    for name, runs in found.items():
        first = next(iter(runs.values()))
        others = {cut: one["scalars"].items() - first["scalars"].items() for cut, one in runs.items() if one != first}
        assert not others, f"{name} differs from the first launch by its digest, and by these scalars: {others}"
    assert len({next(iter(runs.values()))["digest"] for runs in found.values()}) == len(jobs)  # it tells them apart


def changed(job: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """The change, its settings after those of the job."""
    return {**change, "sets": [*job.get("sets", ()), *change.get("sets", ())]}


def part_of(folder: Path, name: str, job: Mapping[str, Any], change: Mapping[str, Any], k: int, parts: int) -> dict:
    """Part k of a job, with a checkpoint before and after it."""
    kept = folder / name.replace(" ", "-")
    kept.mkdir(exist_ok=True)
    part = {**job, **changed(job, change), "steps": job["steps"] * k // parts, "save": str(kept)}
    return part | ({"resume": str(kept)} if k > 1 else {})


def first_ranks(world: Any, n: int) -> Any:
    """The first n ranks as a world of their own, None on the others. Collective; who comes early naps until all have
    come, as ranks that wait for a message take the time of those that work.
    """
    from hpcpic.core.comm.world import World, load_mpi

    come = world.comm.Ibarrier()
    while not come.Test():
        time.sleep(2e-3)
    comm = world.comm.Split(0 if world.rank < n else 1)
    return World(comm, comm.Split_type(load_mpi().COMM_TYPE_SHARED)) if world.rank < n else None


def main(path: str) -> int:
    from hpcpic.core.comm.world import World
    from hpcpic.core.run.failure import guarded

    world = World.start()

    def every_job(_failure: Any) -> int:
        made = []
        for ranks, jobs in groupby(json.loads(Path(path).read_text()), lambda job: job.get("ranks", world.size)):
            if part := first_ranks(world, ranks):
                made += [outcome(part, job) for job in jobs]
        first_ranks(world, world.size)
        if world.rank == 0:
            sys.stdout.write(json.dumps(made) + "\n")
        return 0

    return guarded(world, every_job)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
