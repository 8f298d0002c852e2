"""From the text of an LBM-DEM case to its configuration: vocabulary, checks, defaults."""

from hpcpic.core.case.config import Tree
from hpcpic.core.case.schema import validate
from lbmdem.case.config import LbmDemConfig
from lbmdem.setup.checks import faults
from lbmdem.setup.defaults import completed


def configure(tree: Tree) -> LbmDemConfig:
    """The complete configuration that a tree of settings describes. Raises ConfigError with every fault."""
    return validate(LbmDemConfig, tree, faults, completed)
