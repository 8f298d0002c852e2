"""Older words of the thesis author's program, and those of his input files, as the present ones."""

import difflib
import itertools
from collections.abc import Iterator, Mapping
from typing import Any

from hpcpic.core.case.config import Path, Tree, dotted
from hpcpic.core.case.words import move, one_period

KINDS = ("series", "fields", "particles", "histograms", "checkpoint")  # of output
SAMPLING = ("simulation", "sampling_period")
WRITTEN = ("output", "sampling_period")
OLDER = {  # the thesis's words for output.every
    "series": ((*SAMPLING, "energy"),),
    "fields": ((*WRITTEN, "field"), ("output", "period", "field"), (*SAMPLING, "field")),
    "particles": ((*WRITTEN, "particle"), ("output", "period", "particle"), (*SAMPLING, "particle")),
    "checkpoint": (("output", "checkpoint"),),
}

ITS_DRIFT = 'init_method = "random" gives all of them the drift_velocity'


def modernised(tree: Tree) -> None:
    """Rewrite what his files say otherwise; see Section.modernised."""
    if tree.has(("simulation", "method")):
        if tree.has(("simulation", "solver")):
            tree.drop(("simulation", "solver"))
        move(tree, ("simulation", "method"), ("simulation", "solver"))
    if tree.has(("simulation", "solver")) and tree.data["simulation"]["solver"] == "MFT_TAP":
        tree.data["simulation"]["solver"] = "MFT"
        tree.warnings.append("simulation.solver: MFT_TAP is read as MFT, which has no separate workers here")
    if tree.has(("simulation", "realtime_plot")):
        for name in ("field", "particle"):  # there they set the pace of the live plot, not of files
            if tree.has((*SAMPLING, name)):
                tree.drop((*SAMPLING, name))
                tree.ignored.append(dotted((*SAMPLING, name)))
    one_period(tree, KINDS, OLDER)
    for group, words in ((SAMPLING, ("energy", "field", "particle")), (WRITTEN, ("field", "particle"))):
        emptied(tree, group, words)
    for species in species_of(tree):
        if species.get("velocity_method") == "two-stream" and "init_method" not in species:
            del species["velocity_method"]  # no program of his read it: all took every second particle the other way
            species["init_method"] = "default"
    named_apart(tree)


def species_of(tree: Tree) -> list[dict]:
    """The groups of species; an empty one for what is none."""
    listed = tree.data.get("species")
    return [group if isinstance(group, dict) else {} for group in listed] if isinstance(listed, tuple) else []


def emptied(tree: Tree, group: Path, words: tuple[str, ...]) -> None:
    """Drop a group whose settings have found their places; what is left in it is a fault."""
    if not tree.has(group):
        return
    place, left = tree.where(group), tree.drop(group)
    if not isinstance(left, dict):
        tree.faults.append(f"{place}: {dotted(group)}: must be a group {{ }} of {', '.join(words)}")
        return
    for name in left:
        near = difflib.get_close_matches(name, words, 1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; the keys here are {', '.join(words)}"
        tree.faults.append(f"{tree.where((*group, name))}: {dotted((*group, name))}: unknown key{hint}")


def named_apart(tree: Tree) -> None:
    """Two species of one name, which his program allows, are told apart by their numbers: files of a run go by name."""
    names = [group.get("name") or f"species_{i + 1}" for i, group in enumerate(species_of(tree))]
    wanted, taken = {name for name in names if isinstance(name, str)}, set()
    for i, (group, name) in enumerate(zip(species_of(tree), names)):
        if not isinstance(name, str):
            continue  # refused by the schema
        if name in taken:
            group["name"] = next(other for k in itertools.count(i + 1) if (other := f"{name}_{k}") not in wanted)
            wanted.add(group["name"])
            place = tree.where(("species", i, "name"))
            tree.warnings.append(f"{place}: species[{i}].name: {name!r} is taken; called {group['name']!r} here")
        taken.add(name)


def drift_warnings(species: Mapping[str, Any]) -> Iterator[str]:
    """Warnings where a drift_velocity is no drift, or was none in earlier versions; of a species not yet validated."""
    drift = species.get("drift_velocity")
    drift = drift if isinstance(drift, list | tuple) else (drift,)
    if not any(isinstance(v, int | float) and v for v in drift):
        return
    word, cold = species.get("init_method"), not (species.get("thermal_velocity") or species.get("temperature"))
    if word is None:
        yield (
            "init_method: not given: all particles have the drift_velocity; two opposite beams, which the thesis makes "
            'of it, are init_method = "opposite beams"'
        )
    elif word == "default":
        yield f'init_method: "default" makes two opposite beams, without a mean drift; {ITS_DRIFT}'
    elif word == "random position" and cold:
        yield (
            'init_method: "random position" without a thermal velocity makes velocities uniform in [-v, v], v = '
            f"drift_velocity, without a mean drift; {ITS_DRIFT}"
        )
