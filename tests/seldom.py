"""Cases of a law that only validation tries: another one holds the law in the default run."""

from typing import Any

import pytest


def seldom(*case: Any) -> Any:
    """As `pytest.param`: kernels for it alone take longer to compile, or programs longer to start, than it is worth."""
    return pytest.param(*case, marks=pytest.mark.validation)
