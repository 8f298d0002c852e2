"""run: the main job."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hpcpic.core.app import use
from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.read import Case, read_case, set_option
from hpcpic.core.app.use import use_option
from hpcpic.core.case.derived import enforce

if TYPE_CHECKING:
    from hpcpic.core.cli.job import Plan
    from hpcpic.core.comm.world import World
    from hpcpic.core.files.rundir import RunDir

LOCAL_SIZES = ("MPI_LOCALNRANKS", "OMPI_COMM_WORLD_LOCAL_SIZE")  # where launchers tell the ranks on this machine


def job_options(command: Callable) -> Callable:
    """The options that `run` and `restart` share."""
    for option in (
        click.option("--quiet", is_flag=True, help="Only warnings, errors and the summary."),
        click.option(
            "--checkpoint-every",
            metavar="INTERVAL",
            help="500 (steps), 30s, 15m or 2h; 0s: never before the end.  [default: the case's, or 15m]",
        ),
        click.option(
            "--patience",
            metavar="HH:MM:SS",
            default="0:10:00",
            show_default=True,
            help="Abort if a single step takes longer than this and longer than 20 usual steps.",
        ),
        click.option(
            "--wall",
            metavar="HH:MM:SS",
            help="Stop with a checkpoint before this much time is over.",
        ),
        click.option("--threads", type=click.IntRange(1), help="Threads per rank.  [default: the node's cores shared]"),
    ):
        command = option(command)
    return command


def make_run_command(app_loader: AppLoader) -> click.Command:
    @click.command("run")
    @click.argument("case")
    @click.option("-o", "--output", metavar="DIR", help="Run folder.  [default: the case's output.path, or runs/CASE]")
    @set_option
    @use_option
    @job_options
    @click.option("--dry", is_flag=True, help="Check and estimate only; take no step and make no folder.")
    @click.option("--replace", is_flag=True, help="Replace the run in DIR: its files, and nothing else.")
    @click.option("--force", is_flag=True, help="Run although `check` refuses, where the limit may be overridden.")
    @click.option(
        "--beyond-limits", is_flag=True, help="Run even beyond the stability limits of the scheme, as `stability` does."
    )
    def run(
        case: str,
        output: str | None,
        sets: tuple[str, ...],
        threads: int | None,
        wall: str | None,
        checkpoint_every: str | None,
        patience: str,
        quiet: bool,
        dry: bool,
        replace: bool,
        force: bool,
        beyond_limits: bool,
    ) -> int:
        """Run a case; `mpirun -n N` in front runs it on N ranks."""
        from hpcpic.core.cli.job import Flags, job

        flags = Flags(threads, wall, checkpoint_every, patience, quiet)
        if dry:
            return _dry(app_loader(), case, sets, threads or 1, force)
        return job(app_loader, partial(prepare_run, case, output, sets, replace, force, beyond_limits), flags)

    return run


def prepare_run(
    case: str,
    output: str | None,
    sets: tuple[str, ...],
    replace: bool,
    force: bool,
    beyond_limits: bool,
    app: App,
    world: World,
) -> tuple[RunDir, Plan]:
    """Read the case and make the run folder; on rank 0."""
    from hpcpic.core.cli.check import numbers_of
    from hpcpic.core.cli.estimate import require_memory
    from hpcpic.core.cli.job import Plan
    from hpcpic.core.comm.library import library
    from hpcpic.core.files.given import config_text, contents
    from hpcpic.core.files.provenance import provenance
    from hpcpic.core.files.rundir import RunDir
    from hpcpic.core.simd import frozen

    read = read_case(app, case, sets)
    numbers = numbers_of(app, read.config, world.size)
    warnings = read.tree.warnings + ([] if beyond_limits else enforce(numbers, read.tree, force))
    warnings += require_memory(app, read.config, world.size, world.node_size, force)
    folder = output or run_folder(read)
    text = config_text(read.config, read.tree)
    shown = ("name", "symbol", "value", "unit", "limit", "verdict", "source")
    facts = provenance(library()) | {
        "program": app.name,
        "case": read.path,
        "sets": list(sets),
        "used": use.kept_digests(),
        "own_values": frozen.kept(),
        "derived": [{key: getattr(number, key) for key in shown} for number in numbers],
    }
    given = contents(read.tree) | use.texts()
    rundir = RunDir.create(folder, replace, config=text, given=given, sets=sets, facts=facts)
    allowed = " --beyond-limits" if beyond_limits else " --force" if force else ""
    return rundir, Plan(folder=folder, config=text, allowed=allowed, used=use.texts(), warnings=warnings)


def run_folder(read: Case) -> str:
    """The run folder when the command line names none."""
    asked = getattr(getattr(read.config, "output", None), "path", None)
    return asked or str(Path("runs") / Path(read.path).stem)


def _dry(app: App, case: str, sets: tuple[str, ...], threads: int, force: bool) -> int:
    from hpcpic.core.cli.check import print_check
    from hpcpic.core.cli.estimate import print_estimate, require_memory
    from hpcpic.core.cli.main import launcher_rank
    from hpcpic.core.comm.world import launched_size

    if launcher_rank() == 0:
        read = read_case(app, case, sets)
        ranks = launched_size(os.environ)
        numbers = print_check(app, read, ranks)
        click.echo()
        print_estimate(app, read.config, ranks, threads)
        enforce(numbers, read.tree, force)
        here = next((int(os.environ[name]) for name in LOCAL_SIZES if name in os.environ), ranks)
        for warning in require_memory(app, read.config, ranks, here, force):
            click.echo(f"warning: {warning}", err=True)
    return 0
