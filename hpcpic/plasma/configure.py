"""From the text of a plasma case to its configuration: vocabulary, checks, defaults."""

from hpcpic.core.case.config import Tree
from hpcpic.core.case.schema import validate
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.forecast.estimate import series_period
from hpcpic.plasma.setup.checks import faults
from hpcpic.plasma.setup.defaults import completed


def configure(tree: Tree) -> PlasmaConfig:
    """The complete configuration that a tree of settings describes. Raises ConfigError with every fault."""
    return validate(PlasmaConfig, tree, faults, complete)


def complete(config: PlasmaConfig) -> PlasmaConfig:
    """The case with all defaults; that of the series' period follows from the estimated cost of a step."""
    full = completed(config)
    if full.output.every.series is not None:
        return full
    every = full.output.every.model_copy(update={"series": series_period(full)})
    return full.model_copy(update={"output": full.output.model_copy(update={"every": every})})
