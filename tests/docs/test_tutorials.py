"""The tutorials run from their first cell to their last, and the documentation shows what they give."""

import importlib.util
import json
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


SAID = {  # pictures, and what the page says
    "plasma": (4, "did you mean"), "sph": (4, "did you mean"), "lattice": (4, "did you mean"),
    "trade": (2, "certified"), "batch": (1, "True True"),
}  # fmt: skip
# What the default tests compute less of: numbers of the notebook, and those that stand there instead.
SMALLER = {
    "plasma": {"[0.8, 1.0, 1.3]": "[1.0]"},
    "sph": {"(0.0292, 0.0146, 0.0073)": "(0.0584, 0.0292)", "0.0146": "0.0292", '"spacing": 0.025': '"spacing": 0.05'},
    "lattice": {"(1010.0, 1020.0, 1040.0)": "(1020.0,)"},
    "trade": {},
    "batch": {"0.0146": "0.0292"},
}


@pytest.fixture(scope="module")
def hooks():
    pytest.importorskip("nbconvert")
    found = importlib.util.spec_from_file_location("hooks", DOCS / "hooks.py")
    made = importlib.util.module_from_spec(found)
    found.loader.exec_module(made)
    return made


def check(page, pictures, name):
    pictured, said = SAID[name]
    assert len(pictures) >= pictured and all(picture.startswith(b"\x89PNG") for picture in pictures.values())
    assert all(f"(./{name})" in page for name in pictures)
    assert said in page and "\x1b" not in page  # mistakes are told, not raised


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.validation] * (name != "plasma")) for name in SAID]
)  # all of them run as they stand where the documentation is built, by scripts/test as well
def test_a_tutorial_runs_and_its_page_has_its_pictures(hooks, tmp_path, name):
    """On coarser meshes, or for fewer cases."""
    assert [path.stem for path in hooks.TUTORIALS] == sorted(SAID)
    text = (DOCS / f"tutorials/{name}.ipynb").read_text()
    for number, smaller in SMALLER[name].items():
        number, smaller = json.dumps(number)[1:-1], json.dumps(smaller)[1:-1]  # in a text of the notebook
        assert number in text
        text = text.replace(number, smaller)
    (tmp_path / f"{name}.ipynb").write_text(text)
    check(*hooks.tutorial(tmp_path / f"{name}.ipynb"), name)


@pytest.mark.validation
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [name for name, smaller in SMALLER.items() if smaller])
def test_a_tutorial_runs_as_it_stands(hooks, name):
    check(*hooks.tutorial(DOCS / f"tutorials/{name}.ipynb"), name)
