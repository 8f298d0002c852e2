"""Pages can be read where the sources lie: relative links lead to files of the repository, and to headings there."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")])


def prose(page: Path) -> str:
    if page.suffix == ".md":
        return page.read_text()
    cells = json.loads(page.read_text())["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def anchors(page: Path) -> set[str]:
    """Names of the headings of a page, as the site makes them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower()) for heading in headings}


def test_every_relative_link_leads_to_a_file_of_the_repository_and_to_a_heading_of_it():
    dead, seen = [], 0
    for page in PAGES:
        for link in LINK.finditer(prose(page)):
            target, _, heading = (link[1] or link[2]).partition("#")
            if re.match(r"[a-z]+:", target):
                continue
            seen += 1
            file = (page.parent / target).resolve() if target else page
            there = file.exists() and file.is_relative_to(ROOT)
            if not there or (heading and file.suffix == ".md" and heading not in anchors(file)):
                dead.append(f"{page.relative_to(ROOT)}: {target}#{heading}")
    assert not dead and seen > 100


def test_a_file_that_the_site_writes_out_is_the_one_that_its_line_names():
    """Such a line is only a link, with the path from the root as its text."""
    lines = [(page, *found) for page in PAGES if page.suffix == ".md"
             for found in re.findall(r"^\[([\w./-]+)\]\((\S+)\)$", page.read_text(), re.MULTILINE)]  # fmt: skip
    assert len(lines) > 10
    for page, text, target in lines:
        assert (page.parent / target).resolve() == ROOT / text, page
