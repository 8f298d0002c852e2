"""The look of all figures, their files (PNG, SVG, GIF, MP4; no display), and the figures that need no physics."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from hpcpic.core.errors import FileError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.ticker import Formatter

    from hpcpic.core.case.gauge import Gauge
    from hpcpic.core.files.reader import Run, Snapshots
    from hpcpic.core.files.series import Series

S = TypeVar("S", bound="Snapshots")

INK = "#24292f"  # text and axes; the report turns it into the colour of its own text
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f", "#8c6d1f")
PAPER = "#ffffff"
THEORY: Any = {"color": INK, "linestyle": (0, (5, 3)), "linewidth": 1.4}  # a line of theory: dashed and dark
DOTS_PER_INCH, SCREEN = 150, 72  # of figures in files, and of frames of a GIF
FRAMES_PER_SECOND = 12
BINS = 2000  # pieces that a long line is drawn in


class NoData(ValueError):
    """The run does not hold what a figure shows; the message says what to ask for."""


class NotInScene(NoData):
    """A figure of something that this scene cannot have: nobody who asks for all figures waits for it."""


@dataclass(frozen=True, slots=True)
class Plot:
    """One figure that an app can make: of a whole run, or of its snapshot at a step.

    draw(run), or with `steps` draw(run, step), where None is the last snapshot. steps(run): those of the snapshots,
    which a movie shows one after the other. Both raise NoData.
    """

    title: str
    draw: Callable[..., Figure]
    steps: Callable[[Run], Sequence[int]] | None = None

    def make(self, run: Run, step: int | None = None) -> Figure:
        """The figure; a step means nothing to one of the whole run. Raises NoData."""
        return self.draw(run, step) if self.steps else self.draw(run)


LOOK: Any = {  # of matplotlib
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "axes.facecolor": "none",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10.5,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
    "grid.color": "#8a8f98",
    "grid.alpha": 0.22,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "xtick.labelsize": 9.5,
    "ytick.labelsize": 9.5,
    "font.size": 10,
    "font.family": "sans-serif",
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "image.cmap": "viridis",
    "image.interpolation": "nearest",
    "figure.constrained_layout.use": True,
    "svg.fonttype": "none",
    "svg.hashsalt": "hpcpic",
}


@contextmanager
def style() -> Iterator[None]:
    """The house look, whatever a matplotlibrc says: open axes, few ticks, colours that colour-blind readers can
    tell apart. matplotlib looks at it again when it draws: for making and for saving a figure.
    """
    import matplotlib
    from cycler import cycler

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**LOOK, "axes.prop_cycle": cycler(color=COLOURS)})
        yield


def plain(name: str) -> str:
    """A name that a user gave, as text of a figure: "$" is no formula, and a leading "_" does not hide it."""
    name = name.replace("$", r"\$")
    return f" {name}" if name.startswith("_") else name


def new_figure(rows: int = 1, columns: int = 1, size: tuple[float, float] = (6.4, 3.8), **rest: Any) -> tuple:
    """(figure, axes) without pyplot, so that no figure stays behind in a global list. Call inside style()."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size)
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, **rest)
    for axis in (axis for one in figure.axes for axis in (one.xaxis, one.yaxis)):
        axis.set_major_formatter(_numbers())
        axis.isDefault_majfmt = True  # names take its place
    return figure, axes


def _numbers() -> Formatter:
    """A formatter that gives ticks numbers as plain text, and a power of ten that they share as a formula.

    matplotlib makes a formula of each number, and parses it whenever it measures or draws it: a third of the time that
    a figure took.
    """
    from matplotlib.ticker import ScalarFormatter

    class Numbers(ScalarFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")

    return Numbers()


def save(figure: Figure, path: Path) -> None:
    """PNG on white paper, or SVG as it is, by the ending of the path; replaced only when complete."""
    from hpcpic.core.files.atomic import write_atomic

    if path.suffix == ".svg":
        write_atomic(path, svg(figure))
        return
    write_atomic(path, png(figure))


def png(figure: Figure) -> bytes:
    """The figure on white paper."""
    buffer = io.BytesIO()
    with style():
        figure.savefig(buffer, format="png", dpi=DOTS_PER_INCH, facecolor=PAPER, metadata={"Software": None})
    return buffer.getvalue()


def svg(figure: Figure, prefix: str = "") -> str:
    """The figure as an <svg> element: text stays text, ids get the prefix so that several fit on one page."""
    buffer = io.StringIO()
    with style():
        figure.savefig(buffer, format="svg", dpi=DOTS_PER_INCH, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    if prefix:
        text = re.sub(r'\bid="', f'id="{prefix}', text)
        text = re.sub(r"url\(#", f"url(#{prefix}", text)
        text = re.sub(r'xlink:href="#', f'xlink:href="#{prefix}', text)
    return text


def movie(frames: Iterator[Figure], path: Path) -> None:
    """Write equally large figures as a GIF or an MP4, replaced only when complete. Raises NoData where an MP4 lacks the
    video packages.
    """
    if path.suffix == ".gif":
        from PIL import Image

        from hpcpic.core.files.atomic import write_atomic

        buffer, images = io.BytesIO(), [Image.fromarray(_pixels(figure, SCREEN)) for figure in frames]
        colours = images[-1].quantize(256, Image.Quantize.MAXCOVERAGE)  # a median cut makes bands of a colour bar
        first, *others = (image.quantize(palette=colours, dither=Image.Dither.NONE) for image in images)
        first.save(buffer, "GIF", save_all=True, append_images=others, duration=1000 // FRAMES_PER_SECOND, loop=0)
        write_atomic(path, buffer.getvalue())
        return
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401  (imageio finds it by itself)
    except ImportError as error:
        raise NoData("movies need the extra packages: pip install 'hpcpic[video]'") from error
    made = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        video: Any = imageio.get_writer(made, fps=FRAMES_PER_SECOND, macro_block_size=2, codec="libx264")
        with video as writer:
            for figure in frames:
                writer.append_data(_pixels(figure))
        os.replace(made, path)
    finally:
        made.unlink(missing_ok=True)


def _pixels(figure: Figure, dots_per_inch: float = DOTS_PER_INCH) -> np.ndarray:
    """RGB[height, width, 3] with both sides even, which the codec asks for."""
    figure.set_facecolor(PAPER)
    figure.set_dpi(dots_per_inch)
    canvas: Any = figure.canvas  # of Agg, which its type does not tell
    with style():
        canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    return np.ascontiguousarray(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])


# --------------------------------------------------------------------------------- what a figure shows


def series_of(run: Run) -> Series:
    """The series of a run. Raises NoData."""
    try:
        return run.series
    except FileError as error:
        raise NoData(f"no series: {error}") from error


def columns_of(run: Run, *names: str) -> tuple[np.ndarray, ...]:
    """Times and the scalars asked for, at the rows where all of them have a value. Raises NoData."""
    series = series_of(run)
    missing = [name for name in names if name not in series]
    if missing:
        raise NoData(f"the series lacks {', '.join(missing)}")
    known = np.all([np.isfinite(series[name]) for name in names], axis=0) if names else np.full(len(series.time), True)
    if known.sum() < 2:
        raise NoData("the series lacks a second sample")
    return (series.time[known], *(series[name][known] for name in names))


def present(find: Callable[[], S], what: str) -> S:
    """The snapshots that `find` opens. Raises NoData, with `what` they are."""
    try:
        snapshots = find()
        snapshots.index()
    except FileError as error:
        raise NoData(f"no snapshots of {what}: {error}") from error
    return snapshots


def pictured(snapshots: Snapshots, asked: Sequence[float] = ()) -> list[int]:
    """Numbers of the snapshots that a row of pictures shows: the first and those nearest to the times `asked` for (s)
    that the run has come to, or six from the first to the last.
    """
    if asked:
        reached = [t for t in asked if t <= snapshots.times[-1] * (1 + 1e-6)]
        return sorted({0, *(snapshots.index(time=t) for t in reached)})
    return sorted(set(np.linspace(0, len(snapshots.steps) - 1, 6).round().astype(int).tolist()))


def steps_of(snapshots: Callable[[Run], Snapshots]) -> Callable[[Run], Sequence[int]]:
    """A function for `Plot.steps`: the steps of these snapshots of a run."""
    return lambda run: [int(step) for step in snapshots(run).steps]


# ------------------------------------------------------------------------------- figures without physics


def timers(run: Run) -> Figure:
    """Share of the sections in the time from the first step to the last checkpoint."""
    return timers_figure(run.summary.get("timers", {}))


def timers_figure(timers: Mapping[str, Mapping[str, float]]) -> Figure:
    """Share of each section of the time from the first step to the last checkpoint, longest first, and its spread over
    the ranks.
    """
    if not timers:
        raise NoData("run.json has no timers yet")
    names = list(timers)[::-1]
    with style():
        figure, axes = new_figure(size=(6.4, 0.6 + 0.34 * len(names)))
        shares = [100.0 * timers[name]["share"] for name in names]
        spread = [
            [share * abs(timers[n][end] / timers[n]["avg"] - 1.0) if share else 0.0 for n, share in zip(names, shares)]
            for end in ("min", "max")
        ]
        axes.barh(names, shares, color=COLOURS[0], height=0.62)
        axes.errorbar(shares, names, xerr=spread, fmt="none", ecolor=COLOURS[4], elinewidth=1.6)
        for row, (share, over) in enumerate(zip(shares, spread[1])):
            axes.annotate(f"{share:.1f} %", (share + over, row), (6, 0), textcoords="offset points", va="center")
        axes.set_xlabel("share of the time from the first step to the last checkpoint, %")
        axes.set_xlim(0, 1.2 * max(share + over for share, over in zip(shares, spread[1])))
        axes.grid(axis="y", visible=False)
        return figure


TIMERS = Plot("Where the time went", timers)


def gauges_figure(run: Run, gauges: Sequence[Gauge]) -> Figure:
    """The readings of each gauge in the fields of a grid, in time."""
    if not gauges:
        raise NotInScene("the case has no gauge")
    with style():
        figure, axes = new_figure(len(gauges), 1, (6.4, 2.0 * len(gauges) + 0.6), squeeze=False, sharex=True)
        for axis, gauge in zip(axes[:, 0], gauges):
            names = [name for name in series_of(run) if name in gauge.names]
            if not names:
                raise NoData(f"the series lacks {gauge.name}")
            for name in names:
                axis.plot(*thinned(*columns_of(run, name)), label=plain(name), linewidth=1.3)
            place = f"at ({', '.join(f'{x:g}' for x in gauge.at)}) m"
            size = f", {' x '.join(f'{x:g}' for x in gauge.size)} m wide" if any(gauge.size) else ""
            axis.set(ylabel=axis_label(gauge.what, run.series.units[names[0]]))
            axis.set_title(f"{plain(gauge.name)}: {gauge.take + ' ' if size else ''}{place}{size}")
            if len(names) > 1:
                axis.legend(ncols=3)
        axes[-1, 0].set_xlabel("time, s")
        return figure


def overlay_figure(runs: Mapping[str, Run], name: str) -> Figure:
    """One scalar of several runs in time; logarithmic when it is positive and spans over two decades."""
    found = {label: run for label, run in runs.items() if len(run.series.get(name, ()))}
    if not found:
        raise NoData(f"no run has values of {name}")
    with style():
        figure, axes = new_figure(size=(6.4, 3.2))
        lowest, highest = np.inf, 0.0
        for label, run in found.items():
            values = run.series[name]
            axes.plot(*thinned(run.series.time, values), label=plain(label), alpha=0.9)
            positive = values[values > 0]
            lowest = min(lowest, positive.min()) if positive.size == values.size else 0.0
            highest = max(highest, positive.max(initial=0.0))
        if lowest > 0 and highest > 100 * lowest:
            axes.set_yscale("log")
        unit = next(iter(found.values())).series.units.get(name, "")
        axes.set(xlabel="time, s", ylabel=axis_label(plain(name.replace("_", " ")), unit))
        axes.legend(ncols=2)
        return figure


def thinned(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A long line as its least and largest value in each of at most BINS pieces: looks the same, stays small."""
    size = -(-len(values) // BINS)
    if size <= 2:
        return t, values
    starts = range(0, len(values), size)
    kept = [0, len(values) - 1]
    for filler, extreme in ((np.inf, np.argmin), (-np.inf, np.argmax)):
        known = np.where(np.isnan(values), filler, values)
        kept += [start + int(extreme(known[start : start + size])) for start in starts]
    picked = np.unique(kept)
    return t[picked], values[picked]


def axis_label(text: str, unit: str) -> str:
    """What, comma, unit; a pure number has none."""
    return f"{text}, {unit}" if unit and unit != "1" else text
