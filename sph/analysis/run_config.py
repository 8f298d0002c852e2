"""The case of a run that has been made."""

from functools import lru_cache
from typing import TYPE_CHECKING

from hpcpic.core.case.config import loads
from sph.case.config import SphConfig
from sph.configure import configure
from sph.setup.scene import Scene

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run


@lru_cache(maxsize=8)
def _config(text: str, name: str) -> SphConfig:
    return configure(loads(text, name))


@lru_cache(maxsize=8)
def _scene(text: str, name: str) -> Scene:
    return Scene(_config(text, name))


def config_of(run: "Run") -> SphConfig:
    """The configuration of a run. Raises ConfigError when the case of the folder is not one of this program."""
    return _config(run.config, run.config_file)


def scene_of(run: "Run") -> Scene:
    return _scene(run.config, run.config_file)
