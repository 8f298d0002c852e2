"""report: one HTML page about a run, or about several beside each other; self-contained, without scripts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.text import count, duration, number
from hpcpic.core.app.use import use_option
from hpcpic.core.case.cases import Header, read_header
from hpcpic.core.errors import ConfigError
from hpcpic.core.report.comparison_page import labels, several_runs
from hpcpic.core.report.follow import follow_option, states_of
from hpcpic.core.report.page import NO_HEADER, Drawn, Page, Table, inline, render
from hpcpic.core.report.plot import UNENDED, explained, plots_of, so_far
from hpcpic.core.run.summary import is_dissipation, several, stepping_seconds

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run

MARKS = {"finished": "ok", "stopped": "warn", "running": "warn"}
RELOAD_S = 5  # between two loads of a page that follows its run
SECTIONS = {  # of every simulator
    "scalars": "sums over all particles and nodes for a row of the series",
    "compiling": "kernels that no earlier run had compiled, when the first steps called them",
    "guard": "the ranks agree that all numbers are sound, and whether to go on",
    "checkpoint": "the whole state to disk, for a restart",
    "output series": "rows to series.h5 and series.csv",
    "output field": "snapshots of fields",
    "output particle": "snapshots of particles or grains",
    "output openpmd": "files of openPMD",
    "other": "between the sections",
}


def make_report_command(app_loader: AppLoader) -> click.Command:
    @click.command("report")
    @click.argument("folders", metavar="DIR...", nargs=-1, required=True)
    @use_option
    @click.option(
        "-o",
        "--output",
        metavar="FILE",
        help="The page.  [default: DIR/report.html; comparison.html here for several]",
    )
    @follow_option
    def report(folders: tuple[str, ...], output: str | None, follow: bool) -> None:
        """One HTML page on a run, or a comparison of several: figures, checks, timings, provenance, case.

        With --follow the page of a run loads itself again every few seconds.
        """
        from hpcpic.core.files.reader import open_run

        app = app_loader()
        if len(folders) == 1:
            path = Path(output or Path(folders[0]) / "report.html")
            for run in states_of(folders[0], app.name, follow):
                page = one_run(app, run)
                alive = follow and page.status == "running"
                _write(path, replace(page, reload_s=RELOAD_S) if alive else page)
                click.echo(f"{so_far(run)}: {path}" if follow else path)
        elif follow:
            raise ConfigError("--follow is of one run")
        else:
            opened = [open_run(folder, app.name) for folder in folders]
            page = several_runs(app, dict(zip(labels(folders, opened), opened, strict=True)))
            path = Path(output or "comparison.html")
            _write(path, page)
            click.echo(path)
        for error in page.failures.values():
            raise error

    return report


def _write(path: Path, page: Page) -> None:
    from hpcpic.core.files.atomic import write_atomic

    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, render(page))


def one_run(app: App, run: Run) -> Page:
    facts = run.summary | _newest_sample(run)
    figures, omitted, failures = _figures(app, run)
    status = str(facts.get("status", "unknown"))
    header, description = _case(run)
    return Page(
        program=f"{app.name} · {app.title}",
        title=description or Path(str(facts.get("case", run.path))).stem,
        subtitle=str(run.path),
        status=status if facts.get("exit_code") in (0, None) else f"{status}, exit code {facts['exit_code']}",
        mark=MARKS.get(status, "fail"),
        facts=_key_figures(facts),
        header=header,
        figures=figures,
        omitted=omitted,
        failures=failures,
        tables=[t for t in (_derived(facts), _conserved(run, facts), _timers(app, facts), _estimate(facts)) if t.rows],
        warnings=[*_unended(facts), *(str(w) for w in facts.get("warnings", ()))],
        config=run.config,
        provenance=_provenance(facts),
    )


def _newest_sample(run: Run) -> dict[str, Any]:
    """Step and time of the newest sample of a run under way, or killed; run.json has them at the end only."""
    if run.summary.get("status") not in UNENDED or not (run.path / "series.h5").exists():
        return {}
    step, time = run.series.step, run.series.time
    return {"steps": int(step[-1]), "time": float(time[-1])} if len(step) else {}


def _unended(facts: Mapping[str, Any]) -> list[str]:
    """Why a run has no end, or none that can be seen from here."""
    reason = facts.get("reason")
    return [f"{facts['status']}: {reason}"] if facts.get("status") in UNENDED and reason else []


def _case(run: Run) -> tuple[Header, str]:
    """Header of the case as it was given, and the description in the configuration as used."""
    given = run.rundir.given / Path(str(run.summary.get("case", ""))).name
    header = read_header(given) if given.is_file() else NO_HEADER
    found = re.search(r'^description = "((?:[^"\\]|\\.)*)"', run.config, re.M)
    return header, re.sub(r"\\(.)", r"\1", found[1]) if found else ""


def _figures(app: App, run: Run) -> tuple[list[Drawn], list[str], dict[str, Exception]]:
    """The drawn figures, a line on each that the scene has and the files do not, and the errors of others by name."""
    from hpcpic.core.app.figures import NoData, NotInScene, svg

    drawn, omitted, failures = [], [], {}
    for name, plot in plots_of(app).items():
        try:
            drawn.append(Drawn(plot.title, inline(svg(plot.make(run), f"{name}-"))))
        except NotInScene:
            continue
        except NoData as error:
            omitted.append(f"{plot.title}: {error}")
        except Exception as error:
            omitted.append(f"{plot.title}: failed, {explained(error)}")
            failures[name] = error
    return drawn, omitted, failures


def _key_figures(facts: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    items = facts.get("particles") or facts.get("nodes") or 0
    unit = str(facts.get("work_unit", "particle"))
    found: list[tuple[str, str, str]] = [
        ("steps", count(facts.get("steps", 0)), f"t = {number(facts.get('time'))} s"),
        (f"{unit}s", count(items), ""),
        ("wall time", duration(float(facts.get("wall_seconds") or 0.0)), ""),
        (
            "ranks × threads",
            f"{facts.get('ranks', '?')} × {facts.get('threads', '?')}",
            str(facts.get("cpu", "")).replace("(R)", ""),
        ),
    ]
    for key, name, remark in (
        ("ns_per_particle_step", "ns", "time per particle and step"),
        ("mlups", "MLUPS", "million node updates a second"),
        ("step_ms", "ms", "time per step, median"),
        ("peak_memory_mib_per_rank", "MiB", "peak memory, largest rank"),
    ):
        if key in facts:
            found.append((remark, f"{number(facts[key])} {name}", ""))
    return found


def _derived(facts: Mapping[str, Any]) -> Table:
    rows = [
        (str(n["name"]), str(n.get("symbol", "")), number(n["value"]),
         str(n.get("unit", "")), str(n.get("limit", "")), *_verdict(n), str(n.get("source", "")))
        for n in facts.get("derived", ())
    ]  # fmt: skip
    head = ("number", "symbol", "value", "unit", "limit", "verdict", "source")
    return Table("Derived numbers", head, rows, (2,))


def _verdict(derived: Mapping[str, Any]) -> tuple[str]:
    """Blank where there is no limit that could be met."""
    verdict = str(derived.get("verdict", ""))
    return (verdict if derived.get("limit") or verdict != "ok" else "",)


def _conserved(run: Run, facts: Mapping[str, Any]) -> Table:
    units = run.series.units if (run.path / "series.h5").exists() else {}
    rows = []
    for name, entry in (facts.get("conservation") or {}).items():
        relative = number(entry["relative"]) if "relative" in entry else "—"
        values = (number(entry[key], 9) for key in ("first", "last"))
        meaning = "dissipated by the scheme, by design" if is_dissipation(entry) else ""
        change = number(entry["change"])
        rows.append((name.replace("_", " "), *values, change, units.get(name, ""), relative, meaning))
    head = ("quantity", "at the start", "at the end", "largest change", "unit", "relative", "")
    return Table("Conservation", head, rows, (1, 2, 3, 5))


def _timers(app: App, facts: Mapping[str, Any]) -> Table:
    meanings, timers = {**SECTIONS, **app.sections}, facts.get("timers") or {}
    whole = sum(row["avg"] for row in timers.values())
    rows = [
        (
            name,
            *(f"{row[key]:.3f}" for key in ("min", "avg", "max")),
            f"{100 * row['share']:.1f} %",
            count(row["calls"]) if row.get("calls") else "",
            meanings.get(name, ""),
        )
        for name, row in timers.items()
    ]
    head = ("section", "least, s", "mean, s", "most, s", f"share of {number(whole)} s", "calls", "what is done")
    return Table(
        "Time by section",
        head,
        rows,
        (1, 2, 3, 4, 5),
        "Least, mean and most over the ranks; the time of a section is without that of sections inside it. Together "
        "they are the time from the first step to the end of the last checkpoint; the start stands in the next table.",
    )


def _estimate(facts: Mapping[str, Any]) -> Table:
    """Estimate beside measurement; both count the start of the program and no compiling."""
    guess = facts.get("estimate") or {}
    found: list[tuple[str, float | None, float | None]] = [
        ("time per step, median, ms", guess.get("step_ms"), facts.get("step_ms"))
    ]
    whole, start = guess.get("seconds"), guess.get("start_seconds")
    if whole and start is not None and "start_seconds" in facts and "loop_seconds" in facts:
        loop, early = stepping_seconds(facts), facts["start_compiling_seconds"]
        found += [
            ("all steps and output, s", whole - start, loop),
            ("start and set-up, s", start, facts["start_seconds"] - early),
            ("compiling kernels, once per machine and kind of scene, s", None, facts["loop_seconds"] - loop + early),
        ]
    found.append(("memory per rank, MiB", guess.get("memory_mib_per_rank"), facts.get("peak_memory_mib_per_rank")))
    rows = [
        (name, number(a), number(b), f"{b / a:.2f}" if a else "—")
        for name, a, b in found
        if b is not None and (a or name.startswith("compiling"))
    ]
    compiled = facts.get("compiled_functions")
    note = f"The compiler of {several(compiled, 'function')} is part of the measured memory." if compiled else ""
    head = ("quantity", "estimated", "measured", "ratio")
    return Table("Estimate beside measurement", head, rows, (1, 2, 3), note)


def _provenance(facts: Mapping[str, Any]) -> dict[str, str]:
    git = facts.get("git") or {}
    dirty = " with local changes" if git.get("dirty") else ""
    versions = facts.get("versions") or {}
    found = {
        "started": str(facts.get("started", "")),
        "command": " ".join(map(str, facts.get("command", ()))),
        "settings": " ".join(f"--set {s}" for s in facts.get("sets", ())),
        "commit": f"{git['commit']}{dirty}" if git.get("commit") else "",
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "machine": ", ".join(str(facts[k]) for k in ("host", "cpu", "system") if facts.get(k)),
        "MPI": str(facts.get("mpi", "")),
        "state digest": str(facts.get("state_digest", "")),
    }
    return {name: text for name, text in found.items() if text}
