"""The tutorials run from their first cell to their last, and the documentation shows what they give."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("name", "pictured", "said"),
    [("plasma", 4, "did you mean"), ("sph", 4, "did you mean"), ("lattice", 4, "did you mean"),
     ("trade", 2, "certified"), ("batch", 1, "True True")],
)  # fmt: skip
def test_a_tutorial_runs_and_its_page_has_its_pictures(name, pictured, said):
    pytest.importorskip("nbconvert")
    found = importlib.util.spec_from_file_location("hooks", DOCS / "hooks.py")
    hooks = importlib.util.module_from_spec(found)
    found.loader.exec_module(hooks)
    assert [path.stem for path in hooks.TUTORIALS] == ["batch", "lattice", "plasma", "sph", "trade"]
    page, pictures = hooks.tutorial(DOCS / f"tutorials/{name}.ipynb")
    assert len(pictures) >= pictured and all(picture.startswith(b"\x89PNG") for picture in pictures.values())
    assert all(f"(./{name})" in page for name in pictures)
    assert said in page and "\x1b" not in page  # mistakes are told, not raised
