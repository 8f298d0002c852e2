"""restart: go on from the newest good checkpoint."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from hpcpic.core.app import use
from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.read import set_option
from hpcpic.core.case.config import Tree, load
from hpcpic.core.case.derived import enforce
from hpcpic.core.cli.run import job_options
from hpcpic.core.errors import ConfigError, FileError
from hpcpic.core.files.rundir import RunDir

if TYPE_CHECKING:
    from hpcpic.core.cli.job import Plan
    from hpcpic.core.comm.world import World


def make_restart_command(app_loader: AppLoader) -> click.Command:
    @click.command("restart")
    @click.argument("folder", metavar="DIR")
    @click.option("--until", type=float, metavar="T", help="Go on to this time [s] instead of the case's end.")
    @set_option
    @job_options
    def restart(
        folder: str,
        until: float | None,
        sets: tuple[str, ...],
        threads: int | None,
        wall: str | None,
        checkpoint_every: str | None,
        patience: str,
        quiet: bool,
    ) -> int:
        """Go on from the newest good checkpoint in DIR, on any number of ranks and threads. A finished run stays as it
        is, unless it is to end later.

        --set may change what does not belong to the state: the number of steps, outputs. Other fields or histograms go
        on in fields-2.vtkhdf, histograms-2.h5, beside the earlier ones, and are read with them.
        """
        from hpcpic.core.cli.job import Flags, job

        prepare = partial(prepare_restart, folder, until, sets)
        return job(app_loader, prepare, Flags(threads, wall, checkpoint_every, patience, quiet))

    return restart


def prepare_restart(
    folder: str, until: float | None, sets: tuple[str, ...], app: App, world: World
) -> tuple[RunDir, Plan]:
    """Read the case of a run that is to go on, and hold its folder; on rank 0."""
    from hpcpic.core.cli.estimate import require_memory
    from hpcpic.core.cli.job import Plan
    from hpcpic.core.files.given import kept_text
    from hpcpic.core.run.summary import settled

    rundir = RunDir.open(folder, app.name, damaged=True)
    rundir.lock()
    try:
        facts = facts_of(rundir)
        use.import_to_go_on(facts, rundir.given)
        config, tree, warnings = case_of(app, rundir, until, sets, world.size)
        warnings += rundir.mend()
        history = settled(facts.get("history", []))
        warnings += require_memory(app, config, world.size, world.node_size, force=True)
    except BaseException:
        rundir.unlock()
        raise
    text, texts = kept_text(config, tree, rundir.path), use.texts()
    finished = facts.get("status") == "finished" and facts.get("exit_code") == 0
    return rundir, Plan(folder, text, True, finished, used=texts, warnings=warnings, history=history)


def facts_of(rundir: RunDir) -> dict[str, Any]:
    """The content of run.json; {} where there is none or a damaged one: a restart needs good checkpoints only."""
    try:
        return rundir.read_run()
    except FileError:
        return {}


def case_of(
    app: App, rundir: RunDir, until: float | None, sets: tuple[str, ...], ranks: int
) -> tuple[Any, Tree, list[str]]:
    """The configuration to go on with, and its warnings.

    Raises ConfigError. What --force let pass in the beginning passes again.
    """
    for assignment in sets:
        key = assignment.partition("=")[0].strip()
        if not app.may_change(key):
            raise ConfigError(f"{assignment}: a restart cannot change {key}; it can change {', '.join(app.free)}")
    before = app.configure(load(rundir.config))
    if until is not None:
        forwards = app.time_step is None or app.time_step(before) > 0
        if not math.isfinite(until) or (until < 0) == forwards:
            raise ConfigError(f"until {until:g}: must be a time in s after the start of the run, t = 0")
        sets = (*sets, *app.until(before, until))
    tree = load(rundir.config, sets)
    config = app.configure(tree)
    warnings = enforce(app.derived(config, ranks), tree, force=True)
    return config, tree, warnings
