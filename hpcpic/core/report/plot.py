"""plot: figures of a run, written beside it."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.use import use_option
from hpcpic.core.errors import ConfigError, FileError, HpcpicError
from hpcpic.core.report.follow import follow_option, states_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpcpic.core.app.figures import Plot
    from hpcpic.core.files.reader import Run


UNENDED = ("running", "killed")  # the status of a run whose end run.json does not tell
KINDS = "png", "svg", "gif", "mp4"  # of files


def plots_of(app: App) -> Mapping[str, Plot]:
    """The figures of an app by name; loads what draws them."""
    return app.plots() if app.plots else {}


def make_plot_command(app_loader: AppLoader) -> click.Command:
    @click.command("plot")
    @click.argument("folder", metavar="DIR")
    @click.argument("what", default="all")
    @click.option(
        "-o",
        "--output",
        metavar="PATH",
        help="Where the files go: a folder, or for one figure a file, FIGURE.png.  [default: DIR/plots]",
    )
    @click.option(
        "--format",
        "kind",
        type=click.Choice(KINDS),
        help="gif, mp4: a movie over the snapshots; mp4 wants the extra `video`.  [default: png, or that of the file]",
    )
    @use_option
    @click.option("--step", type=int, help="Snapshot to draw.  [default: the last one]")
    @follow_option
    def plot(folder: str, what: str, output: str | None, kind: str | None, step: int | None, follow: bool) -> None:
        """Draw figures of a run: all that its scene and its files allow, or the one that WHAT names.

        Needs no display. An unknown WHAT lists the names there are. If a figure fails, the others are drawn.
        """
        app = app_loader()
        plots = plots_of(app)
        names = list(plots) if what == "all" else [_known(what, plots)]
        target = Path(output) if output else Path(folder) / "plots"
        path_of = _paths(target, what, kind)
        for run in states_of(folder, app.name, follow):
            outcomes = {}
            for name in names:
                outcomes[name] = _outcome(run, plots[name], path_of(name), step)
                if not follow and isinstance(outcomes[name], Path):
                    click.echo(outcomes[name])
            if follow:
                click.echo(f"{so_far(run)}: {n_drawn(outcomes)} of {len(names)} figures in {target}")
        _tell(folder, what, outcomes)

    return plot


def _paths(target: Path, what: str, kind: str | None) -> Callable[[str], Path]:
    """The file of a figure by its name: in a folder, or the one that is named for WHAT."""
    own = target.suffix[1:]
    if own not in KINDS or target.is_dir():
        return lambda name: target / f"{name}.{kind or KINDS[0]}"
    if what == "all":
        raise ConfigError(f"-o {target}: one file for all figures (name one: plot DIR WHAT -o {target}, or a folder)")
    if kind not in (None, own):
        raise ConfigError(f"-o {target}: a file of another kind than --format {kind}")
    return lambda name: target


def so_far(run: Run) -> str:
    """Where a run stands: its status, with the reason where it has not ended in order, and the step and time of its
    newest sample.
    """
    status = str(run.summary.get("status", "unknown"))
    if status in UNENDED and run.summary.get("reason"):
        status = f"{status} ({run.summary['reason']})"
    if not (run.path / "series.h5").exists() or not len(run.series.step):
        return status
    return f"{status}, step {run.series.step[-1]}, t = {run.series.time[-1]:.5g} s"


def n_drawn(outcomes: Mapping[str, Path | Exception]) -> int:
    """The number of figures that are in files."""
    return sum(isinstance(outcome, Path) for outcome in outcomes.values())


def _outcome(run: Run, plot: Plot, path: Path, step: int | None) -> Path | Exception:
    """The file that was made, or why there is none."""
    try:
        return _draw(run, plot, path, step)
    except Exception as error:
        return error


def _tell(folder: str, what: str, outcomes: Mapping[str, Path | Exception]) -> None:
    """The figures that could not be made. Raises what ended one, or FileError where nothing was drawn."""
    from hpcpic.core.app.figures import NoData, NotInScene

    failed: list[Exception] = []
    missing: dict[str, list[str]] = {}  # why -> figures
    for name, outcome in outcomes.items():
        if isinstance(outcome, Path):
            continue
        if not isinstance(outcome, NoData):
            click.echo(f"failed {name}: {explained(outcome)}", err=True)
            failed.append(outcome)
        elif what != "all":
            raise FileError(f"{folder}: cannot draw {name}: {outcome}") from outcome
        elif not isinstance(outcome, NotInScene):
            missing.setdefault(str(outcome), []).append(name)
    for why, names in missing.items():
        click.echo(f"left out {', '.join(names)}: {why}", err=True)
    if failed:
        raise failed[0]
    if not n_drawn(outcomes):
        raise FileError(f"{folder}: holds nothing that can be drawn yet")


def explained(error: Exception) -> str:
    """In a line; of what is no error of ours its kind too."""
    text = (str(error).strip().splitlines() or [""])[0]
    return text if isinstance(error, HpcpicError) else f"{type(error).__name__}: {text}"


def _known(what: str, plots: Mapping[str, Plot]) -> str:
    if what in plots:
        return what
    near = difflib.get_close_matches(what, plots, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ConfigError(f"no figure is called {what!r}{hint} (there are all, {', '.join(plots)})")


def _draw(run: Run, plot: Plot, path: Path, step: int | None) -> Path:
    """Make one file. Raises NoData."""
    from hpcpic.core.app.figures import NoData, movie, save

    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix not in (".gif", ".mp4"):
        save(plot.make(run, step), path)
        return path
    if plot.steps is None:
        raise NoData("it has no movie")
    movie(_frames(run, plot), path)
    return path


def _frames(run: Run, plot: Plot) -> Iterator[Figure]:
    assert plot.steps is not None
    for step in plot.steps(run):
        yield plot.make(run, step)
