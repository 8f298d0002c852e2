"""The pages of measured figures."""

from pathlib import Path

import pytest

PAGES = sorted((Path(__file__).parents[2] / "docs/measured").glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_begins_with_what_it_found_in_at_most_five_lines(page):
    title, summary, *_ = page.read_text().split("\n\n")
    assert title.startswith("# ")
    assert summary.startswith("In short: ") and len(summary.splitlines()) <= 5
