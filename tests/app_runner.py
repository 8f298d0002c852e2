"""Small runs of any simulator for tests, in processes of their own, many per launch.

`mpirun -n R python app_runner.py JOBS.json` makes every job of a list on its R ranks; rank 0 prints what came out as
one line of JSON. A job is a dict: program, case (text), sets, threads, steps, and optionally `save` (folder for a
checkpoint at the end) or `resume` (folder to go on from).
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
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
    from hpcpic.core.files.config import loads
    from hpcpic.core.files.schema import validate
    from hpcpic.core.tasks import Pool
    from hpcpic.core.timers import Timers

    app = importlib.import_module(f"{program}.__main__").load_app()
    config = validate(app.schema(), loads(case, sets=sets)) if isinstance(case, str) else case
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
            app.restore(checkpoint.newest(RunDir(job["resume"]), world))
        while app.iteration < job["steps"]:
            app.step()
        if "save" in job:
            checkpoint.write(world, RunDir(job["save"]), app.iteration, app.time, app.state())
        scalars = app.scalars()
        digest = checkpoint.digest(world, app.state())
    return {"digest": digest, "scalars": {name: float(value).hex() for name, value in scalars.items()}}


def environment(**extra: str) -> dict[str, str]:
    """Without what a launcher above pytest has set: it would be taken for ours."""
    kept = (key for key in os.environ if key.startswith(USER_KEYS) or not key.startswith(LAUNCHER_KEYS))
    return {key: os.environ[key] for key in kept} | {"PYTHONPATH": str(ROOT)} | extra


def launch(ranks: int, *words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """A Python command line on so many ranks, to the end."""
    command = [str(MPIRUN), "-n", str(ranks), sys.executable, *words]
    return subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=TIMEOUT_S, **options)


def outcomes(folder: Path, ranks: int, jobs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Of jobs made one after the other by one launch on so many ranks."""
    told = folder / f"jobs-{ranks}.json"
    told.write_text(json.dumps(list(jobs)))
    done = launch(ranks, __file__, str(told))
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def check_equal(folder: Path, jobs: Mapping[str, Mapping[str, Any]], cuts: Mapping[int, Sequence[Mapping]]) -> None:
    """Every job gives the same digest and scalars on all cuts[ranks] = changes of the job (threads, sets)."""
    found: dict[str, dict[str, Any]] = {name: {} for name in jobs}
    for ranks, changes in cuts.items():
        asked = [(name, change) for name in jobs for change in changes]
        made = outcomes(folder, ranks, [{**jobs[name], **changed(jobs[name], change)} for name, change in asked])
        for (name, change), one in zip(asked, made, strict=True):
            found[name][f"{ranks} ranks, {change}"] = one
    for name, made in found.items():
        first = next(iter(made.values()))
        assert {cut: one for cut, one in made.items() if one != first} == {}, name
    assert len({next(iter(made.values()))["digest"] for made in found.values()}) == len(jobs)  # it tells them apart


def changed(job: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """The change, its settings after those of the job."""
    return {**change, "sets": [*job.get("sets", ()), *change.get("sets", ())]}


def check_restarted(folder: Path, jobs: Mapping[str, Mapping[str, Any]], cuts: Sequence[tuple[int, Mapping]]) -> None:
    """cuts = (ranks, change)s, one after the other, each from the checkpoint of the one before: as without."""
    whole = outcomes(folder, 1, list(jobs.values()))
    for k, (ranks, change) in enumerate(cuts, start=1):
        asked = []
        for number, job in enumerate(jobs.values()):
            kept = folder / f"job-{number}"
            kept.mkdir(exist_ok=True)
            part = {**job, **changed(job, change), "steps": job["steps"] * k // len(cuts), "save": str(kept)}
            asked.append(part | ({"resume": str(kept)} if k > 1 else {}))
        made = outcomes(folder, ranks, asked)
    assert made == whole


def main(path: str) -> int:
    from hpcpic.core.comm.world import World
    from hpcpic.core.run.failure import guarded

    world = World.start()

    def every_job(_failure: Any) -> int:
        made = [outcome(world, job) for job in json.loads(Path(path).read_text())]
        if world.rank == 0:
            sys.stdout.write(json.dumps(made) + "\n")
        return 0

    return guarded(world, every_job)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
