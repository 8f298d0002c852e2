"""plot: figures of a run, written beside it."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.use import use_option
from hpcpic.core.errors import ConfigError, FileError, HpcpicError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpcpic.core.app.figures import Plot
    from hpcpic.core.files.reader import Run


def plots_of(app: App) -> Mapping[str, Plot]:
    """The figures of an app by name; loads what draws them."""
    return app.plots() if app.plots else {}


def make_plot_command(app_loader: AppLoader) -> click.Command:
    @click.command("plot")
    @click.argument("folder", metavar="DIR")
    @click.argument("what", default="all")
    @click.option("-o", "--output", metavar="FOLDER", help="Where the files go.  [default: DIR/plots]")
    @click.option(
        "--format",
        "kind",
        type=click.Choice(["png", "svg", "gif", "mp4"]),
        default="png",
        show_default=True,
        help="gif, mp4: a movie over the snapshots; mp4 wants the extra `video`.",
    )
    @use_option
    @click.option("--step", type=int, help="Snapshot to draw.  [default: the last one]")
    def plot(folder: str, what: str, output: str | None, kind: str, step: int | None) -> None:
        """Draw figures of a run: all that its scene and its files allow, or the one that WHAT names.

        Needs no display. An unknown WHAT lists the names there are. If a figure fails, the others are drawn.
        """
        from hpcpic.core.app.figures import NoData, NotInScene
        from hpcpic.core.files.reader import open_run

        app = app_loader()
        plots = plots_of(app)
        names = list(plots) if what == "all" else [_known(what, plots)]
        run = open_run(folder, app.name)
        target = Path(output) if output else Path(folder) / "plots"
        written = 0
        failed: list[Exception] = []
        for name in names:
            try:
                click.echo(_draw(run, plots[name], target / f"{name}.{kind}", step))
                written += 1
            except NoData as error:
                if what != "all":
                    raise FileError(f"{folder}: cannot draw {name}: {error}") from error
                if not isinstance(error, NotInScene):
                    click.echo(f"left out {name}: {error}", err=True)
            except Exception as error:
                click.echo(f"failed {name}: {explained(error)}", err=True)
                failed.append(error)
        if failed:
            raise failed[0]
        if not written:
            raise FileError(f"{folder}: holds nothing that can be drawn yet")

    return plot


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
