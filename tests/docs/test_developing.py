"""The worked examples of docs/developing.md: each is a diff that applies to this tree; two do what they say, and with
`-m validation` seven, for a copy of the tree compiles its kernels anew.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PARTS = ("hpcpic", "sph", "lbmdem", "tests", "configs", "scripts", "pyproject.toml")
WORKED = {file.stem: file.read_text() for file in sorted((ROOT / "docs/worked").glob("*.diff"))}
LONG = "smoothing_kernel", "field", "gauge", "figure", "grain_array"
RUN = [("loader", "scalar"), pytest.param(LONG, marks=pytest.mark.validation)]  # with tests


def apply(diff: str, tree: Path, *options: str) -> None:
    done = subprocess.run(
        ["git", "apply", *options, "-"], cwd=tree, input=diff, text=True, capture_output=True,
        env=os.environ | {"GIT_CEILING_DIRECTORIES": str(tree.parent)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", WORKED)
def test_a_worked_example_applies_to_this_tree_and_is_shown(name):
    """If not: patch -p1 --no-backup-if-mismatch < docs/worked/NAME.diff, mend what it rejects, git add -N tests,
    git diff -U2 of the files it names into docs/worked/NAME.diff, and take them back.
    """
    apply(WORKED[name], ROOT, "--check")
    assert not re.search(r"^\+\+\+ b/.*\.(orig|rej)$", WORKED[name], re.MULTILINE)
    assert f"docs/worked/{name}.diff" in (ROOT / "docs/developing.md").read_text()


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("names", RUN)
def test_what_worked_examples_add_works(names, tmp_path):
    """In one copy of the tree, whose kernels are compiled once."""
    for part in PARTS:
        copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
        copy(ROOT / part, tmp_path / part, **({"symlinks": True} if copy is shutil.copytree else {}))
    tests = []
    for name in names:
        apply(WORKED[name], tmp_path)
        added = re.findall(r"^\+\+\+ b/(tests/\S+)", WORKED[name], re.MULTILINE)
        assert added, name
        tests += added
    words = [sys.executable, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", "--timeout", "500", *tests]
    settings = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(words, cwd=tmp_path, env=settings, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert str(tmp_path) in _origin(settings)


def _origin(settings: dict[str, str]) -> str:
    """Where a program started like the tests finds the package."""
    words = [sys.executable, "-P", "-c", "import sph; print(sph.__file__)"]
    return subprocess.run(words, env=settings, capture_output=True, text=True, check=True).stdout
