"""Pilots are many: what git says of this tree is asked once, and their front is drawn by one test only."""

from functools import cache

import pytest

from hpcpic.core.files import provenance
from hpcpic.core.study import front

DRAW = front.draw


@pytest.fixture(autouse=True, scope="session")
def git_is_asked_once():
    asked = provenance._git
    provenance._git = cache(asked)
    yield
    provenance._git = asked


@pytest.fixture(autouse=True)
def undrawn(monkeypatch):
    """No figure of the front: it takes longer than the search."""
    monkeypatch.setattr(front, "draw", lambda *words: None)


@pytest.fixture
def drawn(undrawn, monkeypatch):
    monkeypatch.setattr(front, "draw", DRAW)
