"""Shipped cases and their headers: every file is a legal case that says what it shows."""

import pytest

from hpcpic.core.case.cases import cases_in, find_case, read_header
from hpcpic.core.case.config import load
from hpcpic.core.case.derived import enforce
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.app import shipped_cases
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived

SHIPPED = shipped_cases()
NOISY = ("thesis-1024-on-512", "thesis-10240-on-64")  # 4 electrons per Debye circle, as the thesis has them


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_case_is_legal_on_two_ranks_and_with_no_warning_but_of_noise(name):
    tree = load(SHIPPED[name])
    config = configure(tree)
    told = enforce(derived(config, ranks=2), tree)
    noise = ("N_D = 4.189", "noise of random places W/W(0) = 0.1") if name in NOISY else ()
    assert len(told) == len(noise) and all(map(str.__contains__, sorted(told), sorted(noise))) and tree.warnings == []
    assert config.description and config.periods["series"]


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_case_says_what_it_shows(name):
    header = read_header(SHIPPED[name])
    assert all((header.what, header.source, header.expected)) and header.time.endswith(" s")
    assert float(header.time.split()[0]) < 60


def test_the_cases_of_the_thesis_are_there():
    assert {
        "two-particles",
        "two-stream-cold",
        "cyclotron",
        "thesis-1024-on-512",
        "thesis-10240-on-64",
    } <= set(SHIPPED)
    config = configure(load(SHIPPED["thesis-1024-on-512"]))
    assert config.grid.points == (512, 512) and config.species[0].particles == 1024
    config = configure(load(SHIPPED["thesis-10240-on-64"]))
    assert config.grid.points == (64, 64) and config.species[0].particles == 10240


def test_a_case_is_found_by_path_first_then_by_name(tmp_path):
    mine = tmp_path / "mine.conf"
    mine.write_text("a = 1;")
    assert find_case(str(mine), SHIPPED) == mine
    assert find_case("two-stream-warm", SHIPPED) == SHIPPED["two-stream-warm"]
    with pytest.raises(ConfigError, match="did you mean 'two-stream-warm'"):
        find_case("two-steam-warm", SHIPPED)
    with pytest.raises(ConfigError, match="shipped cases: bump-on-tail, "):
        find_case("zzz", SHIPPED)


def test_a_run_folder_is_no_case_but_has_one(tmp_path):
    (tmp_path / "config.conf").write_text("")
    with pytest.raises(ConfigError, match=r"a folder, not a case file; its case is .*config\.conf"):
        find_case(str(tmp_path), SHIPPED)


def test_cases_are_the_conf_files_of_a_folder(tmp_path):
    (tmp_path / "b.conf").write_text("")
    (tmp_path / "a.conf").write_text("")
    (tmp_path / "README.md").write_text("")
    assert list(cases_in(tmp_path).items()) == [("a", tmp_path / "a.conf"), ("b", tmp_path / "b.conf")]
    assert cases_in(tmp_path / "missing") == {}


def test_a_header_may_run_over_lines_and_be_missing(tmp_path):
    path = tmp_path / "x.conf"
    path.write_text("# what: one\n#   two\n# time: 3 s\na = 1;\n# source: too late\n")
    assert (read_header(path).what, read_header(path).time, read_header(path).source) == (
        "one two",
        "3 s",
        "",
    )
    path.write_text("a = 1;\n")
    assert read_header(path).what == ""
