"""From the text of a plasma case to its configuration: vocabulary, checks, defaults."""

from hpcpic.core.case.config import Tree
from hpcpic.core.case.schema import validate
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.diagnostics import scalars
from hpcpic.plasma.forecast.estimate import default_periods
from hpcpic.plasma.setup.checks import faults
from hpcpic.plasma.setup.defaults import completed


def configure(tree: Tree) -> PlasmaConfig:
    """The complete configuration that a tree of settings describes. Raises ConfigError with every fault."""
    config = validate(PlasmaConfig, tree, lambda config: [*faults(config), *scalars.faults()], complete)
    scalars.units(config)  # ConfigError where two columns have one name
    return config


def complete(config: PlasmaConfig) -> PlasmaConfig:
    """The case with all defaults; those of the periods of series and histograms follow from the estimated cost of a
    step.
    """
    full = completed(config)
    every = full.output.every
    unknown = {kind: steps for kind, steps in default_periods(full).items() if getattr(every, kind) is None}
    output = full.output.model_copy(update={"every": every.model_copy(update=unknown)})
    return full.model_copy(update={"output": output})
