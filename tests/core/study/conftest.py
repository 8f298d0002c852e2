"""Pilots are many: what git says of this tree is asked once."""

from functools import cache

import pytest

from hpcpic.core.files import provenance


@pytest.fixture(autouse=True, scope="session")
def git_is_asked_once():
    asked = provenance._git
    provenance._git = cache(asked)
    yield
    provenance._git = asked
