"""`report`: one file that loads nothing, holds what the run says, and escapes what the user wrote."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import h5py
import pytest
from app_runner import environment
from click.testing import CliRunner
from plasma_reference import make_run
from seldom import seldom

from hpcpic.__main__ import load_app
from hpcpic.core.app.figures import NotInScene, Plot
from hpcpic.core.cli.main import build
from hpcpic.core.errors import FileError
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.report.report import number
from hpcpic.plasma.app import shipped_cases

FEW = ("species[0].particles=512", "species[1].particles=512", "simulation.cycles=200")
NASTY = r'description="<script>alert(1)</script> & \"quoted\""'
VOID = {"meta", "br", "hr", "img", "link", "input"}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    made = [make_run(shipped_cases()["two-stream-cold"], runs / "first", FEW)]
    made.append(
        make_run(shipped_cases()["two-stream-cold"], runs / "second", (*FEW, "simulation.time_step=0.04", NASTY))
    )
    return made


def report(*words):
    return CliRunner().invoke(build(load_app, "hpcpic", "plasma"), ["report", *map(str, words)])


def copied(folder, to, *without):
    """A copy of a run without some of its files: pages without figures of these are made sooner."""
    return shutil.copytree(folder, to, ignore=shutil.ignore_patterns(*without))


@pytest.fixture
def bare_run(folders, tmp_path):
    """What a run says of itself, without its series and snapshots."""
    return copied(folders[0], tmp_path / "bare", "series.h5", "*.vtkhdf")


@pytest.fixture(scope="module")
def page(folders):
    done = report(folders[0])
    assert done.exit_code == 0, done.output
    return (folders[0] / "report.html").read_text(encoding="utf-8")


class Balance(HTMLParser):
    """Collects attributes that could load something, and checks that elements close in order."""

    def __init__(self):
        super().__init__()
        self.open, self.links, self.ids, self.faults = [], [], [], []

    def handle_starttag(self, tag, attributes):
        for key, value in attributes:
            if key in ("src", "href", "xlink:href", "action", "data", "poster"):
                self.links.append(value)
            if key == "id":
                self.ids.append(value)
            if key.startswith("on"):
                self.faults.append(f"{tag} has {key}")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}> out of order")


def test_page_is_well_formed_and_loads_nothing(page):
    found = Balance()
    found.feed(page)
    assert not found.faults and not found.open
    assert all(link.startswith(("#", "data:image/png")) for link in found.links)
    assert "<script" not in page and "@import" not in page
    assert not re.search(r"url\((?!#)", page)
    assert len(found.ids) == len(set(found.ids))


def test_page_says_what_the_run_was(page):
    header = "two equal cold beams, at the wave number that grows fastest"
    for text in (
        "Cold two-stream instability, one wavelength",
        header,
        "finished",
        "Derived numbers",
        "&lt; 2",
        "Conservation",
        "Time by section",
        "Estimate beside measurement",
        "Provenance",
        "0" * 64,
        "space_length = [10.26039864129491",
    ):
        assert text in page, text
    assert page.count("<figcaption>") == 7  # all but the spectrum, which has a reason
    assert "Not drawn: " in page and "Spectrum over wave number and frequency: needs 16 snapshots" in page
    assert 'class="mark warn">warn<' in page


def test_what_the_user_wrote_is_escaped(folders, tmp_path):
    run = copied(folders[1], tmp_path / "run", "series.h5", "*.vtkhdf")  # figures: see names below
    assert report(run).exit_code == 0
    page = (run / "report.html").read_text()
    assert "<script>" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; &#34;quoted&#34;" in page


def test_several_runs_are_laid_beside_each_other(folders, tmp_path):
    path = tmp_path / "new" / "both.html"
    done = report(*folders, "-o", path)
    assert done.exit_code == 0 and str(path) in done.output
    page = path.read_text()
    found = Balance()
    found.feed(page)
    assert not found.faults and len(found.ids) == len(set(found.ids))
    assert "Settings that differ" in page and "simulation.time_step" in page and "simulation.cycles" not in page
    assert ">0.05<" in page and ">0.04<" in page
    assert 1 <= page.count("<figcaption>") <= 8
    assert "<script>" not in page


def test_a_run_that_has_just_begun_has_a_page_alone_and_beside_others(folders, tmp_path):
    """Its series has no rows yet, nor has one that was asked for none, which knows nothing of times either."""
    begun, silent = copied(folders[0], tmp_path / "begun"), copied(folders[0], tmp_path / "silent", "particles.*")
    with h5py.File(begun / "series.h5", "r+") as file:
        for name in file:
            file[name].resize(0, axis=0)
    (silent / "series.h5").unlink()
    facts = json.loads((silent / "run.json").read_text())
    (silent / "run.json").write_text(json.dumps(facts | {"timers": None, "conservation": None}))
    for runs in ((begun,), (silent,), (begun, silent, folders[1])):
        done = report(*runs, "-o", tmp_path / "page.html")
        assert done.exit_code == 0, done.output


def test_a_run_under_way_tells_how_far_its_series_is(folders, tmp_path):
    folder = copied(folders[0], tmp_path / "going", "*.vtkhdf")
    facts = json.loads((folder / "run.json").read_text())
    for name in ("steps", "time", "exit_code"):
        del facts[name]
    (folder / "run.json").write_text(json.dumps(facts | {"status": "running"}))
    held = RunDir(folder)
    held.lock()
    program = build(lambda: app_with("timers"), "hpcpic", "plasma")
    for status in ("running", "killed"):  # with, and without a process that holds the folder
        assert CliRunner().invoke(program, ["report", str(folder)]).exit_code == 0
        words = " ".join(re.sub("<[^>]*>", " ", (folder / "report.html").read_text()).split())
        assert "steps 200 t = 10 s" in words and status in words
        assert ("killed: it left without a word" in words) == (status == "killed")
        held.unlock()


def test_a_folder_without_a_run_is_a_file_error(tmp_path):
    assert report(tmp_path).exit_code == 6
    assert report().exit_code == 2


def test_a_run_that_failed_says_so(bare_run):
    text = (bare_run / "run.json").read_text()
    text = text.replace('"status": "finished"', '"status": "diverged"').replace('"exit_code": 0', '"exit_code": 4')
    (bare_run / "run.json").write_text(text)
    done = report(bare_run)
    assert done.exit_code == 0, done.output
    page = (bare_run / "report.html").read_text()
    assert 'class="mark fail">diverged, exit code 4<' in page
    assert page.count("<figcaption>") == 1  # timers come from run.json


def test_numbers_are_told_with_symbol_limit_verdict_and_source(bare_run):
    facts = json.loads((bare_run / "run.json").read_text())
    known = {"name": "Courant number", "symbol": "C_o", "value": 0.5, "unit": "", "limit": "< 1", "verdict": "ok",
             "source": "thesis (3.4)"}  # fmt: skip
    (bare_run / "run.json").write_text(json.dumps(facts | {"derived": [known]}))
    assert report(bare_run).exit_code == 0
    page = (bare_run / "report.html").read_text()
    for text in ("C_o", "thesis (3.4)", "<th>verdict</th>", "<th>source</th>"):
        assert text in page, text


def app_with(*names):
    """The plasma with these of its figures."""
    app = load_app()
    return replace(app, plots=lambda: {name: app.plots()[name] for name in names})


def rows_of(page, title):
    """first cell -> the other cells of the table under a heading"""
    table = page[page.index(f"<h2>{title}</h2>") :].split("</table>")[0]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row, re.S) for row in table.split("<tr>")]
    return {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows if row}


def test_estimates_stand_beside_what_they_are_of(bare_run):
    """An estimate counts the start and compiles nothing: of 42 s are 10 s of steps, 2 s of start, 30 s of compiling."""
    facts = json.loads((bare_run / "run.json").read_text())
    facts |= {"wall_seconds": 42.5, "loop_seconds": 25.0, "start_seconds": 17.0, "start_compiling_seconds": 15.0}
    facts["loop_compiling_seconds"] = 15.0
    facts["timers"] = {name: {"min": s, "avg": s, "max": s, "share": s / 25.0, "calls": 1}
                       for name, s in (("push", 10.0), ("compiling", 15.0))}  # fmt: skip
    facts["estimate"] = {"step_ms": 1.0, "seconds": 9.0, "start_seconds": 1.0}
    (bare_run / "run.json").write_text(json.dumps(facts))
    assert report(bare_run).exit_code == 0
    page = (bare_run / "report.html").read_text()
    rows = rows_of(page, "Estimate beside measurement")
    assert rows["all steps and output, s"] == ["8", "10", "1.25"]
    assert rows["start and set-up, s"] == ["1", "2", "2.00"]
    assert rows["compiling kernels, once per machine and kind of scene, s"] == ["—", "30", "—"]
    assert not any("wall time" in name for name in rows)
    rows = rows_of(page, "Time by section")
    assert "share of 25 s" in page and [rows[name][3] for name in ("push", "compiling")] == ["40.0 %", "60.0 %"]
    assert rows["push"][-1].startswith("new velocities") and rows["compiling"][-1].startswith("kernels that no earlier")


def test_what_a_scheme_dissipates_is_no_error_of_conservation(folders, tmp_path):
    folder = copied(folders[0], tmp_path / "run", "*.vtkhdf")
    facts = json.loads((folder / "run.json").read_text())
    entry = {"first": 60.0, "last": 36.0, "change": 24.0, "relative": 0.4, "dissipated": True}
    (folder / "run.json").write_text(json.dumps(facts | {"conservation": {"energy_total": entry, "mass": entry}}))
    program = build(lambda: app_with("timers"), "hpcpic", "plasma")
    assert CliRunner().invoke(program, ["report", str(folder)]).exit_code == 0
    rows = rows_of((folder / "report.html").read_text(), "Conservation")
    assert rows["energy total"][3] == "J"
    assert rows["energy total"][-1] == "dissipated by the scheme, by design"


def broken_app(error):
    """The plasma with three of its figures and one more, which fails."""
    app = app_with("timers", "velocities", "modes")

    def fail(run):
        raise error

    def of_another_scene(run):
        raise NotInScene("never here")

    plots = {"broken": Plot("Broken", fail), "other": Plot("Of another scene", of_another_scene)}
    return replace(app, plots=lambda: plots | dict(app.plots()))


@pytest.mark.parametrize("error, code, told", [
    (ZeroDivisionError("division by zero"), 1, "ZeroDivisionError: division by zero"),
    seldom(FileError("x.vtkhdf: damaged"), 6, "x.vtkhdf: damaged"),
])  # fmt: skip
def test_a_figure_that_fails_takes_no_other_with_it(folders, tmp_path, error, code, told):
    program = build(lambda: broken_app(error), "hpcpic", "plasma")
    done = CliRunner().invoke(program, ["report", str(folders[0]), "-o", str(tmp_path / "page.html")])
    assert done.exit_code == code
    page = (tmp_path / "page.html").read_text()
    assert page.count("<figcaption>") == 3 and f"Broken: failed, {told}" in page and "another scene" not in page
    done = CliRunner().invoke(program, ["plot", str(folders[0]), "-o", str(tmp_path / "plots")])
    assert done.exit_code == code and f"failed broken: {told}" in done.output
    assert len(list((tmp_path / "plots").iterdir())) == 3 and "other" not in done.output


def test_runs_of_a_sweep_are_called_by_what_was_swept(folders, tmp_path):
    for k, folder in enumerate(folders):
        copy = copied(folder, tmp_path / f"{k:04d}", "series.h5", "*.vtkhdf")
        sets = [*FEW, f"simulation.time_step={0.05 - 0.01 * k}", *(["simulation.cycles=250"] if k else [])]
        facts = json.loads((copy / "run.json").read_text())
        (copy / "run.json").write_text(json.dumps(facts | {"sets": sets}))
    runs = [tmp_path / "0000", tmp_path / "0001"]
    assert report(*runs, "-o", tmp_path / "page.html").exit_code == 0
    assert "time_step" not in (tmp_path / "page.html").read_text().split("Settings that differ")[0]
    (tmp_path / "table.csv").touch()
    assert report(*runs, "-o", tmp_path / "page.html").exit_code == 0
    page = (tmp_path / "page.html").read_text()
    assert "time_step = 0.05" in page and "time_step = 0.04" in page and ">0000<" not in page


def test_figures_have_our_look_whatever_a_matplotlibrc_says_and_names_are_no_formulas(tmp_path):
    sets = (*FEW, 'species[0].name="$a_b$ 5%"', 'species[1].name="_x$^{"')
    folder = make_run(shipped_cases()["two-stream-cold"], tmp_path / "run", sets)
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nfont.size: 40\naxes.facecolor: red\n")
    words = [sys.executable, "-m", "hpcpic"]
    for verb in (["plot", folder, "phase-space"], ["plot", folder, "velocities", "--format", "svg"]):
        done = subprocess.run([*words, *verb], cwd=tmp_path, env=environment(), capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    drawn = (folder / "plots/velocities.svg").read_text()
    assert "$a_b$ 5%" in drawn and "_x$^{" in drawn and "#ff0000" not in drawn


def dump_dom(page, profile, width):
    """The page as the browser has it in the end; fails when the console has a word to say."""
    done = subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--enable-logging=stderr",
         "--disable-background-networking", f"--user-data-dir={profile}", f"--window-size={width},900",
         "--virtual-time-budget=2000", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "CONSOLE" not in done.stderr, done.stderr
    return done.stdout


needs_browser = pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium")


@needs_browser
def test_a_browser_has_no_complaint(page, folders, tmp_path):
    assert "Time by section" in dump_dom(folders[0] / "report.html", tmp_path / "profile", 1200)


@needs_browser
@pytest.mark.parametrize("width", [420, 1200])
def test_figures_have_a_size_and_nothing_sticks_out_sideways(page, tmp_path, width):
    probe = tmp_path / "probe.html"
    measure = (
        "<script>addEventListener('load', () => { const r = [...document.querySelectorAll('figure svg')]"
        ".map(s => s.getBoundingClientRect()); document.title = JSON.stringify({n: r.length,"
        " small: Math.min(...r.map(b => b.width)), low: Math.min(...r.map(b => b.height)),"
        " wide: document.documentElement.scrollWidth - innerWidth}); });</script>"
    )
    loose = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page)
    probe.write_text(loose.replace("</head>", measure + "</head>"))
    shown = dump_dom(probe, tmp_path / "profile", width)
    title = re.search(r"<title>(\{.*?\})</title>", shown)[1].replace("&quot;", '"')
    sizes = {key: float(value) for key, value in re.findall(r'"(\w+)":(-?[\d.]+)', title)}
    assert sizes["n"] == 7 and sizes["small"] > 250 and sizes["low"] > 60 and sizes["wide"] <= 0


def test_numbers_as_people_read_them():
    assert [number(v) for v in (None, "ok", 65536, 0.25, 1.23456789e-9)] == [
        "—",
        "ok",
        "65\u202f536",
        "0.25",
        "1.235e-09",
    ]
    assert number(float("nan")) == "nan"
