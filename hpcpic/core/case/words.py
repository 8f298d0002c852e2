"""Several words for one quantity: viscosities, periods in seconds or in steps, older spellings.

They meet in the tree, before it is validated. The last one that was set counts, as --set over a file and a file over
what it includes; two in one file are a fault.
"""

import difflib
import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from hpcpic.core.case.config import Path, Tree, dotted

VISCOSITIES = {"dynamic_viscosity": "Pa s", "kinematic_viscosity": "m2/s"}
MOST_STEPS = 2.0**62  # that a case can say
SYNONYMS = {  # what others call a key -> what it may be called here
    **dict.fromkeys(("steps", "nsteps", "n_steps", "iterations"), ("cycles", "end_time")),
    **dict.fromkeys(("end", "tmax", "t_max", "t_end", "tend", "duration", "final_time"), ("end_time", "cycles")),
    **dict.fromkeys(("dt", "timestep", "delta_t"), ("time_step",)),
    **dict.fromkeys(("dx", "dp", "resolution", "cell_size"), ("spacing", "points")),
    **dict.fromkeys(("nu", "viscosity"), ("kinematic_viscosity",)),
    **dict.fromkeys(("mu", "eta"), ("dynamic_viscosity",)),
    **dict.fromkeys(("rho", "rho0", "rho_0"), ("density",)),
    **dict.fromkeys(("nx", "n", "cells"), ("points", "particles", "spacing")),
    **dict.fromkeys(("r", "diam"), ("diameter",)),
    **dict.fromkeys(("v", "u"), ("drift_velocity", "velocity")),
    **dict.fromkeys(("b0", "b_0"), ("magnetic",)),
    **dict.fromkeys(("te", "t_e"), ("temperature",)),
    "h": ("smoothing",),
    "q": ("charge",),
    "m": ("mass",),
    "np": ("particles",),
    "length": ("space_length", "size"),
    "c0": ("sound_speed",),
    "g": ("gravity",),
    "tau": ("relaxation_time",),
    "seed": ("random_seed",),
    **dict.fromkeys(("type", "kind", "quantity"), ("what",)),
    **dict.fromkeys(("position", "location", "where"), ("at",)),
}


def unknown(name: str, known: Collection[str]) -> str:
    """The fault of a name that is none of the known ones, of which there may be none."""
    if not known:
        return f"there is none in this case (got {name!r})"
    *others, last = map(repr, known)
    near = difflib.get_close_matches(name, known, 1, 0.5)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"must be {' or '.join(filter(None, (', '.join(others), last)))} (got {name!r}){hint}"


def one_of(tree: Tree, paths: Iterable[Path]) -> Path | None:
    """The one of these settings that counts, or None; the others are dropped."""
    given = [path for path in paths if tree.has(path)]
    if len(given) < 2:
        return given[0] if given else None
    order = {path: i for i, path in enumerate(tree.places)}
    given.sort(key=lambda path: order.get(newest(tree, path), -1))
    for path, later in itertools.pairwise(given):
        if tree.where(newest(tree, path)).file == tree.where(newest(tree, later)).file:
            place, again = tree.where(path), tree.where(later)
            tree.faults.append(f"{again}: {dotted(later)}: give either this or {dotted(path)}, set at {place}")
        tree.drop(path)
    return given[-1]


def last_side(tree: Tree, group: Path, sides: Sequence[tuple[str, ...]]) -> None:
    """Drop what a group says by other words than the side that was set last, if all words of that side are there. Sides
    of which one file gives both are left to the simulator, as is one of which a word is missing.
    """
    given = [[path for word in side if tree.has(path := (*group, word))] for side in sides]
    files = [{tree.where(newest(tree, path)).file for path in paths} for paths in given]
    if not all(given) or set.intersection(*files):
        return
    order = {path: i for i, path in enumerate(tree.places)}
    last = max(range(len(sides)), key=lambda side: max(order.get(newest(tree, path), -1) for path in given[side]))
    if len(given[last]) == len(sides[last]):
        for path in (path for side, paths in enumerate(given) if side != last for path in paths):
            tree.drop(path)


def newest(tree: Tree, path: Path) -> Path:
    """The path that was set last, of a setting and those in it; else the group around it that was written whole."""
    inside = [other for other in tree.places if other[: len(path)] == path]
    while path and path not in tree.places:
        path = path[:-1]
    return inside[-1] if inside else path


def move(tree: Tree, old: Path, new: Path) -> None:
    """Give a setting another place in the tree; where it stands in the files is kept."""
    place, value = tree.where(old), tree.drop(old)
    group_at(tree, new[:-1])[new[-1]] = value
    if isinstance(value, (dict, list, tuple)):
        for path in [path for path in tree.places if len(path) > len(old) and path[: len(old)] == old]:
            tree.places[(*new, *path[len(old) :])] = tree.places.pop(path)
    tree.places.pop(old, None)
    tree.places[new] = place


def one_viscosity(tree: Tree, fluids: Iterable[Path], own: str, density: float) -> None:
    """The viscosity of each fluid under `own`, one of VISCOSITIES, by its density where the other is given; the bare
    word `viscosity` is taken for `own`. density: that of a fluid that gives none.
    """
    bare = []
    for fluid in fluids:
        kept = one_of(tree, [(*fluid, word) for word in ("viscosity", *VISCOSITIES)])
        if kept is None or kept[-1] == own:
            continue
        group = group_at(tree, fluid)
        if kept[-1] == "viscosity":
            bare.append(dotted(kept))
        else:
            group[kept[-1]] = converted(group[kept[-1]], group.get("density", density), own)
        move(tree, kept, (*fluid, own))
    if bare:
        words = " or ".join(f"{word} ({unit})" for word, unit in VISCOSITIES.items())
        meant = f"{own.replace('_', ' ')} in {VISCOSITIES[own]}"
        tree.warnings.append(f"{', '.join(bare)}: taken for the {meant}; write {words}")


def converted(value: Any, density: Any, own: str) -> Any:
    """The other viscosity as `own`; what is no number is left as it is, to be refused."""
    if any(isinstance(number, bool) or not isinstance(number, (int, float)) for number in (value, density)):
        return value
    return value * density if own == "dynamic_viscosity" else value / density if density else value


def group_at(tree: Tree, path: Path) -> Any:
    """The group at a path, made where there is none."""
    group: Any = tree.data
    for key in path:
        group = group[key] if isinstance(key, int) else group.setdefault(key, {})
    return group


def one_period(tree: Tree, kinds: Iterable[str], older: Mapping[str, tuple[Path, ...]] | None = None) -> None:
    """Each kind of output has a period in seconds (output.period) or in steps (output.every). older: further words
    for the latter, of which the first that is given counts.
    """
    for kind in kinds:
        every = ("output", "every", kind)
        words = [path for path in (older or {}).get(kind, ()) if tree.has(path)]
        for path in words[1:]:
            tree.drop(path)
        kept = one_of(tree, (("output", "period", kind), every, *words[:1]))
        if kept in words:
            output = tree.data.setdefault("output", {})
            if isinstance(output, dict) and isinstance(output.setdefault("every", {}), dict):
                move(tree, kept, every)


def only_seconds(period: Any, every: Any) -> Any:
    """The periods in seconds without those that are given in steps."""
    return period.model_copy(update={name: None for name, steps in every if steps is not None})


def in_steps(every: int | None, seconds: float | None, time_step: float) -> int:
    """The period in steps of a fixed length, as given or the nearest; 0: never."""
    if every is not None:
        return every
    return max(1, round(min(seconds / abs(time_step), MOST_STEPS))) if seconds else 0
