"""sweep: one run per combination of settings, one table. Finished runs are not repeated, a failure stops no other."""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from hpcpic.core.app import use
from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.read import read_case, set_option, shape_options
from hpcpic.core.app.text import Shown, shown, table
from hpcpic.core.app.use import use_option
from hpcpic.core.cli.launch import Start, launch, refuse_launcher
from hpcpic.core.cli.restart import facts_of
from hpcpic.core.errors import CheckFailed, ConfigError, FileError
from hpcpic.core.files.atomic import write_atomic
from hpcpic.core.files.rundir import RunDir

_RANGE = re.compile(r"([^:]+):([^:]+):(\d+)")
_FACTS = ("status", "exit_code", "steps", "time", "wall_seconds", "step_ms", "state_digest")


def make_sweep_command(app_loader: AppLoader) -> click.Command:
    @click.command("sweep")
    @click.argument("case")
    @set_option
    @use_option
    @click.option("-o", "--output", metavar="DIR", help="Folder of the runs.  [default: sweeps/CASE]")
    @click.option(
        "--zip",
        "zipped",
        is_flag=True,
        help="Pair the lists value by value instead of combining them; all must have the same length.",
    )
    @shape_options
    def sweep(case: str, sets: tuple[str, ...], output: str | None, zipped: bool, ranks: int, threads: int) -> int:
        """Run CASE for every combination of --set KEY=1,2,4 or KEY=0.1:0.5:5 (from, to, how many).

        All runs end at the time at which CASE ends: where a setting would change that, the number of steps follows.
        DIR/table.csv has a row per run. Called again it goes on where it stopped.
        """
        refuse_launcher()
        app = app_loader()
        if not sets:
            raise click.UsageError("--set KEY=VALUE,VALUE,... is missing: what is to be swept over?")
        combinations = expand(sets, zipped)
        path = read_case(app, case, combinations[0]).path
        combinations = with_equal_ends(app, path, combinations)
        folder = Path(output or Path("sweeps") / Path(path).stem)
        shape = (ranks, threads)
        rows = []
        for k, combination in enumerate(combinations):
            rundir = RunDir(folder / f"{k:04d}")
            code, words = run_once(app, path, combination, rundir, shape)
            click.echo(f"{k + 1}/{len(combinations)}  {'  '.join(combination)}: {words}")
            rows.append(_row(rundir, combination, code))
            _write(folder / "table.csv", rows)
            if code == 5:
                click.echo(f"stopped after {k + 1} of {len(combinations)} runs; the same command goes on")
                return code
        _tell(rows, folder, results_of(app, path, combinations[0]))
        return 0

    return sweep


def expand(sets: Sequence[str], zipped: bool = False) -> list[tuple[str, ...]]:
    """("a=1,2", "b=0:1:3") -> one --set list per run. Raises ConfigError."""
    lists = [[f"{key}={value}" for value in values] for key, values in map(_values, sets)]
    if not zipped:
        return list(itertools.product(*lists))
    if len({len(values) for values in lists}) > 1:
        raise ConfigError(f"--zip: the lists have {', '.join(str(len(values)) for values in lists)} values")
    return list(zip(*lists)) or [()]


def with_equal_ends(app: App, path: str, combinations: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The combinations, with the settings that end a run where the case ends when what is swept would move its end, as
    another time step does where a case counts steps. An end that the user gives is taken as it is.
    """
    fixed = tuple(assignment for assignment in combinations[0] if all(assignment in sets for sets in combinations))
    try:
        end = _end(app, read_case(app, path, fixed).config)
    except ConfigError:  # the case lacks what is swept
        end = _end(app, read_case(app, path, combinations[0]).config)
    return [_ending_at(app, path, sets, end) for sets in combinations]


def _ending_at(app: App, path: str, sets: tuple[str, ...], end: float | None) -> tuple[str, ...]:
    try:
        config = read_case(app, path, sets).config
    except ConfigError:  # its run will say so
        return sets
    own = _end(app, config)
    if end is None or own is None or app.time_step is None or abs(own - end) <= 0.5 * abs(app.time_step(config)):
        return sets
    more = app.until(config, math.copysign(end, app.time_step(config)))
    given = {assignment.partition("=")[0].strip() for assignment in sets}
    return sets if given & {assignment.partition("=")[0] for assignment in more} else (*sets, *more)


def _end(app: App, config: Any) -> float | None:
    """When the run of a case ends, s; None where the app does not tell."""
    return app.knobs(config).time if app.knobs else None


def _values(assignment: str) -> tuple[str, list[str]]:
    key, equal, text = assignment.partition("=")
    if not equal:
        raise ConfigError(f"--set {assignment}: expected key=value,value,...")
    found = _RANGE.fullmatch(text)
    if not found:
        return key, split(text)
    try:
        low, high, n = float(found[1]), float(found[2]), int(found[3])
    except ValueError:
        n = 0
    if not n:
        raise ConfigError(f"--set {assignment}: expected from:to:count")
    return key, [repr(low + (high - low) * i / max(1, n - 1)) for i in range(n)]


def split(text: str) -> list[str]:
    """At the commas outside brackets and quotes: '1,[2,3],"a,b"' -> three values."""
    parts, depth, quoted = [""], 0, False
    for c in text:
        quoted ^= c == '"'
        depth += (c in "[({") - (c in "])}") if not quoted else 0
        if c == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += c
    return parts


def run_once(
    app: App,
    path: str,
    sets: tuple[str, ...],
    rundir: RunDir,
    shape: tuple[int, int],
    flags: tuple[str, ...] = (),
    start: Start = launch,
) -> tuple[int, str]:
    """Exit code of the run of one combination, and how it went in words.

    A finished one is left as it is, a stopped one goes on. flags: more words for `run`. Raises FileError.
    """
    facts = facts_of(rundir)
    same = (facts.get("sets"), facts.get("used", {})) == (list(sets), use.kept_digests())
    same = same and _is_of(app, path, sets, rundir)
    if rundir.run_json.exists() and not same:
        raise FileError(
            f"{rundir.path} holds a run of another sweep, or of the case before it was changed; "
            "choose another folder with -o"
        )
    if same and facts.get("exit_code") == 0:
        return 0, "done before"
    if same and facts.get("exit_code") == 5:
        words = ["restart", str(rundir.path)]
    else:
        if rundir.run_json.exists():
            rundir.lock()  # no other process works in it
            shutil.rmtree(rundir.path)  # an earlier attempt of this sweep
            rundir.unlock()
        words = ["run", path, "-o", str(rundir.path), *flags, *use.words()]
        words += [word for assignment in sets for word in ("--set", assignment)]
    ranks, threads = shape
    rundir.path.parent.mkdir(parents=True, exist_ok=True)
    output = rundir.path.parent / f"{rundir.path.name}.txt"
    with open(output, "w", encoding="utf-8") as screen:
        words += ["--threads", str(threads), "--quiet"]
        code = start(app.program, words, ranks, stdout=screen, stderr=subprocess.STDOUT)
    facts = facts_of(rundir)
    if code == 0 and facts.get("exit_code") != 0:
        return 1, f"exit 0, but no finished run in {rundir.path}: is what was started {app.name}?"
    if code in (0, 5):
        return code, f"exit {code}  "
    told = (
        facts.get("reason") if facts.get("exit_code") == code else None
    )  # of what has diverged, which ends in a table
    lines = output.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return code, f"exit {code}  {told or (lines[-1] if lines else '')}"


def _is_of(app: App, path: str, sets: tuple[str, ...], rundir: RunDir) -> bool:
    """True if a run was made of this case as it is now: its files may have changed since."""
    from hpcpic.core.files.given import config_text

    try:
        read = read_case(app, path, sets)
        return rundir.config.read_text(encoding="utf-8") == config_text(read.config, read.tree)
    except (OSError, ConfigError):
        return False


def _row(rundir: RunDir, sets: tuple[str, ...], code: int) -> dict[str, Any]:
    """Settings, how it went, and the last value of every scalar."""
    row: dict[str, Any] = {"run": rundir.path.name}
    row |= {key: value for key, _, value in (assignment.partition("=") for assignment in sets)}
    facts = facts_of(rundir)
    row |= {key: facts.get(key) for key in _FACTS} | {"exit_code": code}
    if facts.get("status") == "finished" and (rundir.path / "series.h5").exists():
        from hpcpic.core.files.series import read_series

        series = read_series(rundir.path)
        row |= {name: float(values[-1]) for name, values in series.items() if len(values)}
    return row


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, _columns(rows), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(path, text.getvalue())


def _columns(rows: list[dict[str, Any]]) -> list[str]:
    """Those that some row has: the settings, how it went, the scalars."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    settings = _settings(rows)
    return sorted(names, key=lambda name: name not in settings)


def _settings(rows: list[dict[str, Any]]) -> set[str]:
    return {name for row in rows for name in itertools.takewhile(lambda name: name not in _FACTS, row)}


def _short(value: Any) -> str:
    """A cell; settings are texts, those of numbers are numbers in JSON."""
    if value is None:
        return ""
    if isinstance(value, float):
        return shown(value, ".6g")
    cell = Shown(value)
    with suppress(ValueError):
        cell.value = float(value) if not str(value).isdigit() else int(value)
    return cell


def results_of(app: App, path: str, sets: tuple[str, ...]) -> list[str]:
    """Names of what the case is about, as `tradeoff` knows it; some are columns of its series."""
    config = read_case(app, path, sets).config
    return [quantity.name for quantity in app.knobs(config).quantities()] if app.knobs else []


def _tell(rows: list[dict[str, Any]], folder: Path, results: Sequence[str]) -> None:
    """The table as far as it is not too wide: settings, results, how it went, other scalars."""
    settings = _settings(rows)
    columns = sorted(_columns(rows), key=lambda name: (name not in settings, name not in results))
    shown = [name for name in columns if name != "state_digest"][:12]
    table(shown, [[_short(row.get(name)) for name in shown] for row in rows])
    others = [name for name in columns if name not in shown]
    click.echo(f"table: {folder / 'table.csv'}" + (f", with {', '.join(others)} too" if others else ""))
    failed = sum(row["exit_code"] != 0 for row in rows)
    if failed:
        raise CheckFailed(f"{failed} of {len(rows)} runs failed; their output is in {folder}/NNNN.txt")
