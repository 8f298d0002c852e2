"""compare: two runs side by side. Also the regression tool: exit code 3 beyond the tolerance."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from hpcpic.core.app.app import AppLoader
from hpcpic.core.app.text import shown, table
from hpcpic.core.errors import CheckFailed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hpcpic.core.files.reader import Run


@dataclass(frozen=True, slots=True)
class Difference:
    """max and rms of a - b, and `relative`: max over the largest |a|. NaN where both are NaN is equal."""

    what: str
    max: float
    rms: float
    relative: float


def make_compare_command(app_loader: AppLoader) -> click.Command:
    @click.command("compare")
    @click.argument("a")
    @click.argument("b")
    @click.option(
        "--tol",
        type=click.FloatRange(0),
        default=1e-12,
        show_default=True,
        help="Largest difference relative to the largest value.",
    )
    def compare(a: str, b: str, tol: float) -> None:
        """Config, series, last snapshots, timers and final state of two run folders.

        Exit code 3 when anything differs by more than --tol, or is in one of them only.
        """
        from hpcpic.core.files.reader import open_run

        program = app_loader().name
        runs = (open_run(a, program), open_run(b, program))
        _print_configs(*runs)
        differences: list[Difference] = []
        missing: list[str] = []
        for found in (*_series(*runs), *_fields(*runs), *_particles(*runs)):
            if isinstance(found, str):
                missing.append(found)
            else:
                differences.append(found)
        _print_differences(differences, tol)
        _print_timers(*runs)
        digests = [run.summary.get("state_digest") for run in runs]
        same = None not in digests and digests[0] == digests[1]
        click.echo(f"final state: {'the same bits' if same else _not_same(runs)}")
        for text in missing:
            click.echo(text)
        beyond = [d.what for d in differences if _verdict(d, tol) == "fail"]
        if beyond or missing or not (differences or same):
            reasons = [*beyond, *missing] or ["nothing in common to compare"]
            raise CheckFailed(f"beyond the tolerance {tol:g}: {', '.join(reasons)}")

    return compare


def _not_same(runs: Sequence[Run]) -> str:
    """What is told of final states that are not the same bits: which run has none, and why."""
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


def difference(what: str, a: NDArray, b: NDArray) -> Difference | str:
    """The difference of two arrays, or a sentence when their shapes differ."""
    import numpy as np

    if a.shape != b.shape:
        return f"{what}: shape {a.shape} and {b.shape}"
    if not a.size:
        return Difference(what, 0.0, 0.0, 0.0)
    a, b = a.astype(np.float64), b.astype(np.float64)
    apart = np.where(np.isnan(a) & np.isnan(b), 0.0, np.abs(a - b))
    largest = float(np.nanmax(np.abs(a))) if np.isfinite(a).any() else 0.0
    most = float(apart.max())
    relative = 0.0 if most == 0 else most / largest if largest else float("inf")
    return Difference(
        what, most, float(np.sqrt(np.mean(apart**2))), relative if relative == relative else float("inf")
    )


def _series(a: Run, b: Run) -> Iterator[Difference | str]:
    have = [(run.path / "series.h5").exists() for run in (a, b)]
    if have[0] != have[1]:
        yield f"series: only in {a.path if have[0] else b.path}"
    if not all(have):
        return
    import numpy as np

    first, second = a.series, b.series
    if not len(first.step) and not len(second.step):
        yield "series: no row in either run, so nothing to compare"
        return
    same = first.step.tolist() == second.step.tolist()
    if not same:
        rows = f"{len(first.step)} and {len(second.step)} rows"
        yield f"series: sampled at different times ({rows}), b interpolated in time"
    if not len(second.time):
        return
    rows = (first.time >= second.time[0]) & (first.time <= second.time[-1])
    if not rows.any():
        yield "series: no time in common"
        return
    yield from _common("series", first.keys(), second.keys())
    for name in first:
        if name in second:
            other = second[name] if same else np.interp(first.time[rows], second.time, second[name])
            yield difference(f"series {name}", first[name] if same else first[name][rows], other)


def _common(kind: str, a: Any, b: Any) -> Iterator[str]:
    for name in sorted(set(a) ^ set(b)):
        yield f"{kind} {name}: only in the {'first' if name in a else 'second'} run"


def _fields(a: Run, b: Run) -> Iterator[Difference | str]:
    if not (yield from _same_last("fields", a, b)):
        return
    step = a.field_snapshots.steps[-1]
    names = [run.field_snapshots.names_at(-1) for run in (a, b)]
    yield from _common("field", *names)
    for name in names[0]:
        if name in names[1]:
            yield difference(f"field {name}, step {step}", a.field(name), b.field(name))


def _particles(a: Run, b: Run) -> Iterator[Difference | str]:
    if not (yield from _same_last("particles", a, b)):
        return
    step = a.particle_snapshots.steps[-1]
    yield from _common("species", a.particle_snapshots.species, b.particle_snapshots.species)
    for species in a.particle_snapshots.species:
        if species in b.particle_snapshots.species:
            first, second = a.particles(species), b.particles(species)
            yield from _common(species, first, second)
            for name in first:
                if name in second:
                    yield difference(f"{species} {name}, step {step}", first[name], second[name])


def _same_last(kind: str, a: Run, b: Run) -> Generator[str, None, bool]:
    """True if both runs have snapshots of `kind` ("fields" or "particles"), the last ones of the same step."""
    have = [getattr(run.rundir, kind).exists() for run in (a, b)]
    if have[0] != have[1]:
        yield f"{kind}: only in {a.path if have[0] else b.path}"
    if not all(have):
        return False
    last = [next(iter(getattr(run, f"{kind[:-1]}_snapshots").steps[::-1].tolist()), None) for run in (a, b)]
    if last[0] != last[1]:
        yield f"{kind}: last snapshot of step {last[0]} and {last[1]}"
    return last[0] == last[1] is not None


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
