"""restart: go on from the newest good checkpoint."""

from __future__ import annotations

from typing import Any

import click

from hpcpic.core.cli.app import App, AppLoader
from hpcpic.core.cli.read import set_option
from hpcpic.core.cli.run import job_options
from hpcpic.core.errors import ConfigError


def make_restart_command(app_loader: AppLoader) -> click.Command:
    @click.command("restart")
    @click.argument("folder", metavar="DIR")
    @click.option(
        "--until", type=float, metavar="T", help="Go on to this time [s] instead of the case's end."
    )
    @set_option
    @job_options
    def restart(
        folder: str,
        until: float | None,
        sets: tuple[str, ...],
        threads: int | None,
        wall: str | None,
        checkpoint_every: str | None,
        quiet: bool,
    ) -> int:
        """Go on from the newest good checkpoint in DIR, on any number of ranks and threads.

        --set may change what does not belong to the state: the number of steps, outputs.
        """
        from hpcpic.core.cli.job import Flags, Plan, job
        from hpcpic.core.files.rundir import RunDir

        def prepare(app: App) -> tuple[RunDir, Plan]:
            rundir = RunDir.open(folder)
            facts = rundir.read_run()
            rundir.lock()
            text = _config(app, rundir, until, sets)
            rundir.update(status="running", exit_code=None)
            plan = Plan(
                folder=folder,
                config=text,
                restart=True,
                history=facts.get("history", []),
            )
            return rundir, plan

        return job(app_loader, prepare, Flags(threads, wall, checkpoint_every, quiet))

    return restart


def _config(app: App, rundir: Any, until: float | None, sets: tuple[str, ...]) -> str:
    """The text of the configuration to go on with; config.conf is replaced when it differs. Raises
    ConfigError.
    """
    from hpcpic.core.files.config import load
    from hpcpic.core.files.rundir import write_atomic
    from hpcpic.core.files.schema import dump, validate

    for assignment in sets:
        key = assignment.partition("=")[0].strip()
        if not any(key == free or key.startswith((f"{free}.", f"{free}[")) for free in app.free):
            raise ConfigError(
                f"--set {assignment}: a restart cannot change {key}; it can change {', '.join(app.free)}"
            )
    before = validate(app.schema(), load(rundir.config))
    if until is not None:
        sets = (*sets, *app.until(before, until))
    text = dump(validate(app.schema(), load(rundir.config, sets)))
    if text != dump(before):
        write_atomic(rundir.config, text)
    return text
