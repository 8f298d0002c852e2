"""Pages can be read where the sources lie: every relative link leads to a file of the repository."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")
OUTSIDE = re.compile(r"[a-z]+:|#")  # https:, mailto:, a place of the page itself
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")])


def prose(page: Path) -> str:
    if page.suffix == ".md":
        return page.read_text()
    cells = json.loads(page.read_text())["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def test_every_relative_link_leads_to_a_file_of_the_repository():
    dead, seen = [], 0
    for page in PAGES:
        for link in LINK.finditer(prose(page)):
            target = (link[1] or link[2]).partition("#")[0]
            if target and not OUTSIDE.match(target):
                seen += 1
                file = (page.parent / target).resolve()
                if not file.exists() or not file.is_relative_to(ROOT):
                    dead.append(f"{page.relative_to(ROOT)}: {target}")
    assert not dead and seen > 100


def test_a_file_that_the_site_writes_out_is_the_one_that_its_line_names():
    """Such a line is only a link, with the path from the root as its text."""
    lines = [(page, *found) for page in PAGES if page.suffix == ".md"
             for found in re.findall(r"^\[([\w./-]+)\]\((\S+)\)$", page.read_text(), re.MULTILINE)]  # fmt: skip
    assert len(lines) > 10
    for page, text, target in lines:
        assert (page.parent / target).resolve() == ROOT / text, page
