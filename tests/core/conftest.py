"""The toy simulator as a fixture."""

from pathlib import Path
from typing import Any

import pytest
from toy_runner import Toy


@pytest.fixture
def toy(tmp_path: Path) -> Any:
    made = Toy(tmp_path)
    yield made
    for process in made.started:
        if process.poll() is None:
            process.kill()
            process.communicate()
