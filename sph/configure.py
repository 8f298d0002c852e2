"""From the text of an SPH case to its configuration: vocabulary, checks, defaults."""

from hpcpic.core.case.config import Tree
from hpcpic.core.case.schema import validate
from sph.case.columns import series_units
from sph.case.config import SphConfig
from sph.setup.checks import faults
from sph.setup.defaults import completed


def configure(tree: Tree) -> SphConfig:
    """The complete configuration that a tree of settings describes. Raises ConfigError with every fault."""
    config = validate(SphConfig, tree, faults, completed)
    series_units(config)  # ConfigError where two columns have one name
    return config
