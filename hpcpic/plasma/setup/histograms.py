"""Histograms of a case: what is wrong with them, and what they are where the case does not say."""

import math
from collections.abc import Iterator

from hpcpic.core.case.schema import Fault, abridged
from hpcpic.plasma.case.config import (
    HISTOGRAM_AXES,
    Histogram,
    PlasmaConfig,
    name_of,
    velocity_components,
)
from hpcpic.plasma.setup.loaders import loader_of

MOST_BINS = 2**20  # of a histogram: every block has its own counts
MOST_CELLS = 1024  # bins of a position, by default
VELOCITY_BINS = 200
SPREADS = 6.0  # thermal velocities from the mean to the ends


def axes_of(config: PlasmaConfig) -> tuple[str, ...]:
    """What can be counted in a scene."""
    names = [*HISTOGRAM_AXES]
    return (*names[: config.dimensions], *names[3 : 3 + velocity_components(config)])


def histogram_faults(config: PlasmaConfig) -> Iterator[Fault]:
    species = [name_of(one, i) for i, one in enumerate(config.species)]
    names = [one.name for one in named(config)]
    for i, histogram in enumerate(config.histogram):
        here: tuple = ("histogram", i)
        name, axes = names[i], histogram.of
        if "/" in name or name in ("", ".", "..", "step", "time"):
            yield (*here, "name"), f"{name!r} is no name for a group of a file"
        elif name in names[:i]:
            yield (*here, "name"), f"histogram[{names.index(name)}] is called {name!r} already"
        if histogram.species not in species and (histogram.species or len(species) != 1):
            got = f"(got {abridged(histogram.species)})" if histogram.species else ""
            yield (*here, "species"), f"must be one of the species {', '.join(species)} {got}".rstrip()
        known = axes_of(config)
        unknown = [axis for axis in axes if axis not in known]
        if unknown:
            yield (*here, "of"), f"{abridged(unknown[0])} is no axis of this scene; there are {', '.join(known)}"
        if len(axes) not in (1, 2) or len(set(axes)) < len(axes):
            yield (*here, "of"), f"needs one axis or two different ones (got {len(axes)})"
        for key in ("bins", "low", "high"):
            if len(given := getattr(histogram, key)) not in (0, len(axes)):
                yield (*here, key), f"needs {len(axes)} number(s), one for each of {', '.join(axes)} (got {len(given)})"
        if bool(histogram.low) != bool(histogram.high):
            yield (*here, "low" if histogram.low else "high"), "give low and high, or neither"
        for low, high, axis in zip(histogram.low, histogram.high, axes):
            if not low < high:
                yield (*here, "high"), f"must be above low on the axis {axis} (got {high:g}, low is {low:g})"
        if math.prod(histogram.bins) > MOST_BINS:
            yield (*here, "bins"), f"at most {MOST_BINS} bins in all (got {math.prod(histogram.bins)})"


def named(config: PlasmaConfig) -> list[Histogram]:
    """The histograms, each with a name."""
    return [
        one if one.name else one.model_copy(update={"name": f"histogram_{i + 1}"})
        for i, one in enumerate(config.histogram)
    ]


def completed_histograms(config: PlasmaConfig) -> tuple[Histogram, ...]:
    """With name, species, bins and limits; of a case whose species are complete."""
    return tuple(completed(config, one) for one in named(config))


def completed(config: PlasmaConfig, histogram: Histogram) -> Histogram:
    species = histogram.species or config.species[0].name
    bins, low, high = zip(*(default_bins(config, species, axis) for axis in histogram.of))
    given = {"bins": histogram.bins or bins, "low": histogram.low or low, "high": histogram.high or high}
    return histogram.model_copy(update={"species": species, **given})


def default_bins(config: PlasmaConfig, name: str, axis: str) -> tuple[int, float, float]:
    """Bins, low and high: of a position the cells of the box, of a velocity 6 thermal velocities, or the drift, beyond
    the means of all populations; of a species at rest a cell per step.
    """
    number = [*HISTOGRAM_AXES].index(axis)
    if HISTOGRAM_AXES[axis] == "m":
        n = config.points[number]
        return n // -(-n // MOST_CELLS), 0.0, config.simulation.space_length[number]
    species = next(one for one in config.species if one.name == name)
    parts = [loader_of(species).populations(species, k) for k in range(velocity_components(config))]
    wave = species.perturbation.velocity_amplitude if species.perturbation else 0.0
    reach = max(max(SPREADS * part.spread + abs(wave), abs(part.mean)) for axis_parts in parts for part in axis_parts)
    reach = reach or config.simulation.space_length[0] / config.points[0] / abs(config.simulation.time_step)
    means = [part.mean for part in parts[number - 3]]
    return VELOCITY_BINS, min(means) - reach, max(means) + reach
