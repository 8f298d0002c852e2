"""hpcpic: particle-and-grid simulators on one parallel substrate; in Python, the plasma's cases and runs, and the
errors that all three simulators raise.
"""

from typing import TYPE_CHECKING

from hpcpic.core.lazy import lazy
from hpcpic.version import __version__

if TYPE_CHECKING:
    from hpcpic.core.errors import CheckFailed, ConfigError, Diverged, FileError, HpcpicError
    from hpcpic.plasma.api import Case, Run, Simulation, cases, open_run

__all__ = [
    "Case",
    "CheckFailed",
    "ConfigError",
    "Diverged",
    "FileError",
    "HpcpicError",
    "Run",
    "Simulation",
    "__version__",
    "cases",
    "open_run",
]
__getattr__, __dir__ = lazy(
    __name__,
    {
        "hpcpic.plasma.api": ("Case", "Run", "Simulation", "cases", "open_run"),
        "hpcpic.core.errors": ("CheckFailed", "ConfigError", "Diverged", "FileError", "HpcpicError"),
    },
)
