"""compare: two runs side by side. Also the regression tool: exit code 3 beyond the tolerance."""

from __future__ import annotations

import math
import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.text import shown, table
from hpcpic.core.errors import CheckFailed, ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hpcpic.core.files.reader import Run
    from hpcpic.core.files.series import Series


@dataclass(frozen=True, slots=True)
class Difference:
    """max and rms of a - b, and `relative`: max over the largest |a|, or over that of its kind. NaN where both are NaN
    is equal.
    """

    what: str
    max: float
    rms: float
    relative: float


class Note(str):
    """A remark on a comparison, which counts as no difference."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs beside each other, a and b.

    differences: of the columns of the series, and of the fields and particles of the last snapshots. missing: what one
    of them lacks, or what cannot be compared, in words; notes: remarks that count as no difference. same_state: the
    final states are the same bits.
    """

    differences: tuple[Difference, ...]
    missing: tuple[str, ...]
    notes: tuple[str, ...]
    same_state: bool

    def beyond(self, tolerance: float) -> list[str]:
        """What differs by more, relative to the largest |a|, and what is missing; [] of runs that are alike."""
        found = [d.what for d in self.differences if _verdict(d, tolerance) == "fail"] + list(self.missing)
        return found if found or self.differences or self.same_state else ["nothing in common to compare"]


def compared(a: Run, b: Run, app: App) -> Comparison:
    """Series, last snapshots and final states of two runs of a program."""
    digests = [run.summary.get("state_digest") for run in (a, b)]
    same = None not in digests and digests[0] == digests[1]
    config = _case_of(a, app)
    mass = app.mass(config) if config is not None and app.mass else 0.0
    periods = app.periods(config) if config is not None and app.periods else ()
    found = [*_series(a, b, same, mass), *_fields(a, b), *_particles(a, b, periods)]
    return Comparison(
        tuple(one for one in found if isinstance(one, Difference)),
        tuple(one for one in found if isinstance(one, str) and not isinstance(one, Note)),
        tuple(one for one in found if isinstance(one, Note)),
        same,
    )


def _case_of(run: Run, app: App) -> Any:
    """The config of a run, None where this process cannot read it, as one with physics of somebody else's own."""
    from hpcpic.core.app.use import import_kept
    from hpcpic.core.case.config import loads

    try:
        import_kept(run.summary, run.rundir.given)
        return app.configure(loads(run.config, run.config_file))
    except ConfigError:
        return None


def make_compare_command(app_loader: AppLoader) -> click.Command:
    @click.command("compare")
    @click.argument("a")
    @click.argument("b")
    @click.option(
        "--tol",
        type=click.FloatRange(0),
        default=1e-12,
        show_default=True,
        help="Largest difference relative to the largest value, of a column of the series to that of its kind.",
    )
    def compare(a: str, b: str, tol: float) -> None:
        """Config, series, last snapshots, timers and final state of two run folders.

        Exit code 3 when anything differs by more than --tol, or is in one of them only.

        The largest value of a column of the series is that of all components, modes, slices and numbers of its kind
        (momentum_x and momentum_y; mode_1_re and mode_2_im), of a momentum at least sqrt(2 m E) of all mass at the
        kinetic energy: one that is 0 by symmetry differs by rounding alone. Places differ by the shortest way, through
        the sides along which the box repeats.
        Series that were sampled at other times are compared at the times that they share, else b interpolated in time;
        where the final states are the same bits, as of a restarted run, what that makes of the series is told and does
        not count. Last snapshots are compared if they are of one time, whatever their steps.
        """
        from hpcpic.core.files.reader import open_run

        app = app_loader()
        runs = (open_run(a, app.name), open_run(b, app.name))
        _print_configs(*runs)
        found = compared(*runs, app)
        _print_differences(found.differences, tol)
        _print_timers(*runs)
        click.echo(f"final state: {'the same bits' if found.same_state else _not_same(runs)}")
        for text in (*found.notes, *found.missing):
            click.echo(text)
        if beyond := found.beyond(tol):
            raise CheckFailed(f"beyond the tolerance {tol:g}: {', '.join(beyond)}")

    return compare


def _not_same(runs: Sequence[Run]) -> str:
    """A remark on final states that are not the same bits: "different", or which run has none, and why."""
    open_ends = [
        ": ".join([f"{run.path} is {run.summary.get('status', 'unknown')}", *filter(None, [run.summary.get("reason")])])
        for run in runs
        if run.summary.get("state_digest") is None
    ]
    return f"not known, as {'; '.join(open_ends)}" if open_ends else "different"


def _print_differences(differences: Sequence[Difference], tolerance: float) -> None:
    rows = [
        (d.what, *(shown(value, ".3e") for value in (d.max, d.rms, d.relative)), _verdict(d, tolerance))
        for d in differences
    ]
    table(("what", "max |a - b|", "rms", "relative", "verdict"), rows, right=("max |a - b|", "rms", "relative"))


def _verdict(difference: Difference, tolerance: float) -> str:
    return "ok" if difference.relative <= tolerance else "fail"


def difference(what: str, a: NDArray, b: NDArray, scale: float = 0.0) -> Difference | str:
    """The difference of two arrays, relative to the largest |a| or to the scale where that is larger; a sentence when
    their shapes differ.
    """
    import numpy as np

    if a.shape != b.shape:
        return f"{what}: shape {a.shape} and {b.shape}"
    if not a.size:
        return Difference(what, 0.0, 0.0, 0.0)
    a, b = a.astype(np.float64), b.astype(np.float64)
    apart = np.where(np.isnan(a) & np.isnan(b), 0.0, np.abs(a - b))
    largest = max(_largest(a), scale)
    most = float(apart.max())
    relative = 0.0 if most == 0 else most / largest if largest else float("inf")
    return Difference(what, most, float(np.sqrt(np.mean(apart**2))), relative if relative == relative else float("inf"))


def _largest(a: NDArray) -> float:
    import numpy as np

    return float(np.nanmax(np.abs(a))) if np.isfinite(a).any() else 0.0


def kind_of(column: str) -> str:
    """The column without what numbers its components, modes and slices: mode_2_1_re is a mode."""
    return re.sub(r"(_(\d+|[xyz]|re|im))+$", "", column)


def _series(a: Run, b: Run, same_end: bool = False, mass: float = 0.0) -> Iterator[Difference | str]:
    """same_end: the final states are the same bits. mass: of all particles of a, kg, where no column tells it."""
    have = [(run.path / "series.h5").exists() for run in (a, b)]
    if have[0] != have[1]:
        yield f"series: only in {a.path if have[0] else b.path}"
    if not all(have):
        return
    first, second = a.series, b.series
    lengths = f"({len(first.step)} and {len(second.step)} rows)"
    if not len(first.step) and not len(second.step):
        yield "series: no row in either run, so nothing to compare"
        return
    if not len(first.step) or not len(second.step):
        yield f"series: sampled at different times {lengths}"
        return
    match = _match(first, second)
    if not len(match.rows):
        yield "series: no time in common"
        return
    if match.remark:
        text = f"series: sampled at different times {lengths}, {match.remark}"
        yield Note(text) if _as_long(first.time, second.time) else text
    yield from _common("series", first.keys(), second.keys())
    kinds = {name: (kind_of(name), first.units.get(name)) for name in first}
    scales: dict[Any, float] = {}
    for name, kind in kinds.items():
        scales[kind] = max(scales.get(kind, 0.0), _largest(first[name][match.rows]))
        if kind[0] == "momentum" and "energy_kinetic" in first:
            most = _largest(first["mass"][match.rows]) if "mass" in first else mass
            scales[kind] = max(scales[kind], math.sqrt(2 * most * _largest(first["energy_kinetic"][match.rows])))
    for name, kind in kinds.items():
        if name in match.values:
            apart = difference(f"series {name}", first[name][match.rows], match.values[name], scales[kind])
            if match.interpolated and same_end and isinstance(apart, Difference):  # error of the interpolation
                apart = Note(f"{apart.what}: interpolated within {apart.relative:.2g}")
            yield apart


@dataclass(frozen=True, slots=True)
class Match:
    """Rows of one series at which another is compared, and the values of that there, by name."""

    rows: NDArray
    values: Mapping[str, NDArray]
    remark: str = ""
    interpolated: bool = False


def _match(a: Series, b: Series) -> Match:
    """The rows of a, and b there: at the same steps, at the times that both have, or else b interpolated in time."""
    import numpy as np

    if a.step.tolist() == b.step.tolist():
        return Match(np.arange(len(a.step)), b)
    rows, others = _shared(a.time, b.time)
    if len(rows):
        shared = {name: values[others] for name, values in b.items()}
        return Match(rows, shared, f"compared at {len(rows)} that both have")
    rows = np.flatnonzero((a.time >= b.time[0]) & (a.time <= b.time[-1]))
    interpolated = {name: np.interp(a.time[rows], b.time, values) for name, values in b.items()}
    return Match(rows, interpolated, "b interpolated in time", interpolated=True)


def _shared(a: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
    """The rows at times that both have, to rounding, where these are all of one of them as long as both go on; else
    none.
    """
    import numpy as np

    near = 1e-9 * max(float(np.ptp(a)), float(np.ptp(b)))
    after = np.clip(np.searchsorted(b, a), 1, max(1, len(b) - 1))
    nearest = np.where(np.abs(a - b[after - 1]) <= np.abs(a - b[after % len(b)]), after - 1, after % len(b))
    rows = np.flatnonzero(np.abs(a - b[nearest]) <= near)
    end = min(a[-1], b[-1]) + near
    if len(rows) < min((a <= end).sum(), (b <= end).sum()):
        rows = rows[:0]
    return rows, nearest[rows]


def _as_long(a: NDArray, b: NDArray) -> bool:
    """True if two series begin and end together, as far as their samples tell: apart by less than those lie apart."""
    import numpy as np

    apart = max(float(np.diff(times).max(initial=0.0)) for times in (a, b))
    return all(abs(one - other) < (1 - 1e-6) * apart for one, other in ((a[0], b[0]), (a[-1], b[-1])))


def _common(kind: str, a: Any, b: Any) -> Iterator[str]:
    for name in sorted(set(a) ^ set(b)):
        yield f"{kind} {name}: only in the {'first' if name in a else 'second'} run"


def _fields(a: Run, b: Run) -> Iterator[Difference | str]:
    at = yield from _same_last("fields", a, b)
    if not at:
        return
    names = [run.field_snapshots.names_at(-1) for run in (a, b)]
    yield from _common("field", *names)
    for name in names[0]:
        if name in names[1]:
            yield difference(f"field {name}, {at}", a.field(name), b.field(name))


def _particles(a: Run, b: Run, periods: Sequence[float]) -> Iterator[Difference | str]:
    """periods: after which the box repeats along each axis, m; infinite where it does not."""
    at = yield from _same_last("particles", a, b)
    if not at:
        return
    offsets = [run.particle_snapshots.time_offsets for run in (a, b)]
    yield from _common("species", a.particle_snapshots.species, b.particle_snapshots.species)
    for species in a.particle_snapshots.species:
        if species in b.particle_snapshots.species:
            first, second = a.particles(species), b.particles(species)
            yield from _common(species, first, second)
            for name in first:
                times = [of.get(name, 0.0) for of in offsets]
                if name in second and not _same_time(*times):
                    yield Note(f"{species} {name}: {times[0]:+g} and {times[1]:+g} s from the positions, not compared")
                elif name in second:
                    near = _nearest(first[name], second[name], periods) if name == "position" else second[name]
                    yield difference(f"{species} {name}, {at}", first[name], near)


def _nearest(a: NDArray, b: NDArray, periods: Sequence[float]) -> NDArray:
    """b [n, d], each place as the one of its images in a box that repeats which is nearest to that of a."""
    near = b.copy()
    for axis, period in enumerate(periods if a.shape == b.shape else ()):
        if math.isfinite(period):
            near[:, axis] += period * ((a[:, axis] - b[:, axis]) / period).round()
    return near


def _same_last(kind: str, a: Run, b: Run) -> Generator[str, None, str]:
    """The step or time of the last snapshots of `kind` ("fields" or "particles") where both runs have one of the same
    time, else "".
    """
    have = [getattr(run.rundir, kind).exists() for run in (a, b)]
    if have[0] != have[1]:
        yield f"{kind}: only in {a.path if have[0] else b.path}"
    if not all(have):
        return ""
    found = [getattr(run, f"{kind[:-1]}_snapshots") for run in (a, b)]
    if not all(len(snapshots.steps) for snapshots in found):
        if any(len(snapshots.steps) for snapshots in found):
            yield f"{kind}: no snapshot yet in {(b if len(found[0].steps) else a).path}"
        return ""
    (step, other), (time, later) = ([getattr(one, of)[-1] for one in found] for of in ("steps", "times"))
    if _same_time(time, later):
        return f"step {step}" if step == other else f"t = {time:.6g} s"
    yield f"{kind}: last snapshot at t = {time:.6g} s (step {step}) and {later:.6g} s (step {other})"
    return ""


def _same_time(a: float, b: float) -> bool:
    """To rounding: runs whose steps have other lengths come to the same time by other sums."""
    return abs(a - b) <= 1e-9 * max(abs(a), abs(b))


def _print_configs(a: Run, b: Run) -> None:
    rows = [(key, *values) for key, values in _config_difference(a.config, b.config).items()]
    if rows:
        table(("config", "a", "b"), rows)
    else:
        click.echo("config: the same")


def _config_difference(a: str, b: str) -> dict[str, tuple[str, str]]:
    from hpcpic.core.case.config import leaves, loads
    from hpcpic.core.case.texts import value_text

    first, second = ({key: value_text(v) for key, v in leaves(loads(text).data)} for text in (a, b))
    keys = dict.fromkeys([*first, *second])
    return {k: (first.get(k, "-"), second.get(k, "-")) for k in keys if first.get(k) != second.get(k)}


def _print_timers(a: Run, b: Run) -> None:
    first, second = (run.summary.get("timers") or {} for run in (a, b))
    rows = [
        (name, *(shown(t[name]["avg"], ".3f") if name in t else "-" for t in (first, second)))
        for name in dict.fromkeys([*first, *second])
    ]
    shapes = [f"{run.summary.get('ranks')} x {run.summary.get('threads')}" for run in (a, b)]
    table(("section, mean s", "a", "b"), [*rows, ("ranks x threads", *shapes)], right=("a", "b"))
