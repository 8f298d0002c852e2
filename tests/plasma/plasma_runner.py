"""Small plasma runs for tests: in this process, in processes of their own as a user would, many per launch.

`mpirun -n R python plasma_runner.py JOBS.json` makes every job of a list on its R ranks; rank 0 prints what
came out as one line of JSON. A job is a dict: case, sets, threads, steps, and optionally `save` (folder for a
checkpoint at the end) or `resume` (folder to go on from).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
MPIRUN = Path(sys.executable).with_name("mpirun")
LAUNCHER_KEYS = ("PMI", "OMPI", "PMIX", "MPI", "HYDI")
USER_KEYS = ("OMPI_ALLOW",)  # which Open MPI wants from root
TIMEOUT_S = 300  # compilation of all kernels included

PARTICLES = 10_000  # of both cases
PLANE = """
simulation = { cycles = 20; time_step = 0.1; space_length = [37.0, 60.0]; random_seed = 7; };
grid = { points = [37, 40]; };
field = { magnetic = [0.0, 0.0, 1.0]; };
species = (
  { name = "electrons"; particles = 6000; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
    drift_velocity = [3.0, 2.0]; thermal_velocity = 1.5; init_method = "random position"; },
  { name = "ions"; particles = 4000; charge = 1.0; mass = 20.0; plasma_frequency = 0.3;
    drift_velocity = [-1.0, 0.5]; thermal_velocity = 0.3; init_method = "quiet"; } );
"""
LINE = """
simulation = { cycles = 20; time_step = 0.1; space_length = [97.0]; random_seed = 5; };
grid = { points = [301]; };
species = (
  { name = "beam"; particles = 5000; charge = -1.0; mass = 1.0; plasma_frequency = 0.7;
    drift_velocity = [3.0]; thermal_velocity = 0.5; init_method = "random position"; },
  { name = "other"; particles = 5000; charge = -1.0; mass = 1.0; plasma_frequency = 0.7;
    drift_velocity = [-3.0]; thermal_velocity = 0.2; init_method = "quiet";
    perturbation = { mode = [2]; amplitude = 0.1; }; } );
"""


def configuration(case: str, sets: Sequence[str] = ()) -> Any:
    """The case as a typed configuration, as `run` sees it."""
    from hpcpic.core.files.config import loads
    from hpcpic.core.files.schema import validate
    from hpcpic.plasma.config import PlasmaConfig

    return validate(PlasmaConfig, loads(case, sets=sets))


@contextmanager
def plasma(world: Any, case: str, sets: Sequence[str] = (), threads: int = 1) -> Iterator[Any]:
    """The simulator at its initial state; the config may also be given ready made."""
    from hpcpic.core.tasks import Pool
    from hpcpic.core.timers import Timers
    from hpcpic.plasma.step import Plasma

    config = configuration(case, sets) if isinstance(case, str) else case
    pool = Pool(threads, world.cpus(threads))
    try:
        app = Plasma(config, world, pool, Timers())
        yield app
        app.close()
    finally:
        pool.close()


def outcome(world: Any, job: Mapping[str, Any]) -> dict[str, Any]:
    """Digest of the state at the end, the counted charge and particles, and the scalars bit for bit."""
    from hpcpic.core.files.rundir import RunDir
    from hpcpic.core.run import checkpoint

    with plasma(world, job["case"], job.get("sets", ()), job.get("threads", 1)) as app:
        if "resume" in job:
            app.restore(checkpoint.newest(RunDir(job["resume"]), world))
        while app.iteration < job["steps"]:
            app.step()
        if "save" in job:
            checkpoint.write(world, RunDir(job["save"]), app.iteration, app.time, app.state())
        scalars = app.scalars()
        return {
            "digest": checkpoint.digest(world, app.state()),
            "charge": scalars["charge"],
            "particles": int(app.moments.counts().sum()),
            "scalars": [value.hex() for value in scalars.values()],
        }


def environment(**extra: str) -> dict[str, str]:
    """Without what a launcher above pytest has set: it would be taken for ours."""
    kept = (key for key in os.environ if key.startswith(USER_KEYS) or not key.startswith(LAUNCHER_KEYS))
    own = {key: os.environ[key] for key in kept}
    return own | {"PYTHONPATH": str(ROOT)} | extra


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
