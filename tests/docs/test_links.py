"""Pages can be read where the sources lie: every relative link leads to a file of the repository."""

import json
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")
OUTSIDE = re.compile(r"[a-z]+:|#")  # https:, mailto:, a place of the page itself


def listed() -> list[Path]:
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in done.stdout.split("\0") if name]


def prose(page: Path) -> str:
    if page.suffix == ".md":
        return page.read_text()
    cells = json.loads(page.read_text())["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


@pytest.fixture(scope="module")
def files() -> set[Path]:
    if not (ROOT / ".git").exists():
        pytest.skip("only a clone knows its files")
    return set(listed())


def test_every_relative_link_leads_to_a_file_of_the_repository(files):
    dead, seen = [], 0
    for page in sorted(file for file in files if file.suffix in (".md", ".ipynb")):
        for link in LINK.finditer(prose(page)):
            target = (link[1] or link[2]).partition("#")[0]
            if target and not OUTSIDE.match(target):
                seen += 1
                if (page.parent / target).resolve() not in files:
                    dead.append(f"{page.relative_to(ROOT)}: {target}")
    assert not dead and seen > 100


def test_a_file_that_the_site_writes_out_is_the_one_that_its_line_names(files):
    """Such a line is only a link, with the path from the root as its text."""
    lines = [(page, *found) for page in files if page.suffix == ".md"
             for found in re.findall(r"^\[([\w./-]+)\]\((\S+)\)$", page.read_text(), re.MULTILINE)]  # fmt: skip
    assert len(lines) > 10
    for page, text, target in lines:
        assert (page.parent / target).resolve() == ROOT / text, page
