"""The page of report about several runs beside each other."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hpcpic.core.app.app import App
from hpcpic.core.app.text import number
from hpcpic.core.report.page import Drawn, Page, Table, inline

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run

OVERLAYS = 8  # scalars drawn over each other


def labels(folders: Sequence[str], runs: Sequence[Run]) -> list[str]:
    """Labels of runs: those of a sweep by the settings that differ, others by the last parts of their paths, or by
    the whole paths where these are not enough.
    """
    names = [Path(folder).resolve().name for folder in folders]
    if all(name.isdigit() and (run.path.resolve().parent / "table.csv").exists() for name, run in zip(names, runs)):
        swept = swept_labels([run.summary.get("sets") or () for run in runs])
        if len(set(swept)) == len(swept):
            return swept
    return names if len(set(names)) == len(names) else [os.path.normpath(folder) for folder in folders]


def swept_labels(sets: Sequence[Sequence[str]]) -> list[str]:
    """Labels of --set lists: what is not the same in all, keys by their last words where these differ."""
    settings = [dict(assignment.partition("=")[::2] for assignment in given) for given in sets]
    common = [key for key in settings[0] if all(key in of_run for of_run in settings)]
    keys = [key for key in common if len({of_run[key] for of_run in settings}) > 1]
    words = [key.rpartition(".")[2] for key in keys]
    shown = {key: word if words.count(word) == 1 else key for key, word in zip(keys, words)}
    return [", ".join(f"{shown[key]} = {of_run[key]}" for key in keys) for of_run in settings]


def several_runs(app: App, runs: Mapping[str, Run]) -> Page:
    failed = [label for label, run in runs.items() if run.summary.get("exit_code") != 0]
    return Page(
        program=f"{app.name} · {app.title}",
        title=f"{len(runs)} runs beside each other",
        subtitle=", ".join(runs),
        status=f"{len(failed)} not finished" if failed else "all finished",
        mark="warn" if failed else "ok",
        facts=[],
        figures=_overlays(runs),
        tables=[t for t in (_results(runs), _conservation_of(runs), _settings(runs)) if t.rows],
    )


def _overlays(runs: Mapping[str, Run]) -> list[Drawn]:
    from hpcpic.core.app.figures import NoData, overlay_figure, series_of, svg

    drawn: list[Drawn] = []
    try:
        common = [set(series_of(run)) for run in runs.values()]
    except NoData:  # a run without series has nothing to be laid over
        return []
    for name in next(iter(runs.values())).series:
        if len(drawn) == OVERLAYS or not all(name in names for names in common):
            continue
        if all(run.series[name].size == 0 or (run.series[name] == run.series[name][0]).all() for run in runs.values()):
            continue
        try:
            figure = overlay_figure(runs, name)
        except NoData:
            continue
        drawn.append(Drawn(name.replace("_", " "), inline(svg(figure, f"{name}-"))))
    return drawn


def _results(runs: Mapping[str, Run]) -> Table:
    """A row for each fact that some run has, a column for each run."""
    keys = {
        "status": "status",
        "steps": "steps",
        "time": "time, s",
        "ranks": "ranks",
        "threads": "threads per rank",
        "particles": "particles",
        "nodes": "nodes",
        "wall_seconds": "wall time, s",
        "step_ms": "ms per step",
        "ns_per_particle_step": "ns per particle and step",
        "mlups": "MLUPS",
        "peak_memory_mib_per_rank": "peak memory per rank, MiB",
        "state_digest": "state digest",
    }
    rows = []
    for key, name in keys.items():
        values = [run.summary.get(key) for run in runs.values()]
        if any(value is not None for value in values):
            cells = [str(v)[:12] if key == "state_digest" else number(v) for v in values]
            rows.append((name, *cells))
    return Table("Results", ("", *runs), rows, tuple(range(1, len(runs) + 1)))


def _conservation_of(runs: Mapping[str, Run]) -> Table:
    names: dict[str, None] = {}
    for run in runs.values():
        names |= dict.fromkeys(run.summary.get("conservation") or {})
    rows = []
    for name in names:
        entries = [(run.summary.get("conservation") or {}).get(name, {}) for run in runs.values()]
        rows.append((name.replace("_", " "), *(number(e.get("relative", e.get("change"))) for e in entries)))
    note = "Largest change, relative to the start where that is not zero."
    return Table("Conservation", ("", *runs), rows, tuple(range(1, len(runs) + 1)), note)


def _settings(runs: Mapping[str, Run]) -> Table:
    """Keys of the configurations that are not the same in all runs."""
    from hpcpic.core.case.config import leaves, loads

    flat = [dict(leaves(loads(run.config).data)) for run in runs.values()]
    keys = {key: None for settings in flat for key in settings}
    rows = [
        (key, *(str(settings.get(key, "—")) for settings in flat))
        for key in keys
        if len({str(settings.get(key)) for settings in flat}) > 1
    ]
    return Table("Settings that differ", ("", *runs), rows)
