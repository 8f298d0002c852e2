"""Forecasts of a run before it starts, in the form that check, estimate and the report read."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from hpcpic.core.space.declared import Array

OF_EVERY_RUN = ("click", "lark", "pydantic", "numpy", "numba", "mpi4py", "h5py")
LISTED = 16  # ranks, at most, whose rows are told one by one


def listed(title: str, lines: Iterable[str]) -> list[str]:
    """Lines for `check --plan` under a title."""
    return [title, *(f"  {line}" for line in lines)]


def imports(*of_the_scene: str) -> list[str]:
    """Lines for `check --plan`: the libraries that a run imports, those of every run and those of this scene."""
    return listed("imports of a run", [", ".join((*OF_EVERY_RUN, *of_the_scene))])


def slabs(cuts: Sequence[int]) -> list[str]:
    """Lines for `check --plan`: the rows of each rank, or of many the fewest and the most."""
    rows = [high - low for low, high in pairwise(cuts)]
    told = " ".join(map(str, rows)) if len(rows) <= LISTED else f"{min(rows)} to {max(rows)}"
    return ["slabs of the ranks, by their cost at the start", f"  rows       {told}"] if len(rows) > 1 else []


def array_lines(arrays: Iterable[Array]) -> Iterator[str]:
    """Name, shape, type and size of each array."""
    for array in arrays:
        shape = " x ".join(map(str, array.shape))
        yield f"{array.name:<26}{shape:<24}{array.dtype:<12}{array.bytes / 2**20:10.2f} MiB"


@dataclass(frozen=True, slots=True)
class Estimate:
    """memory: item -> bytes per rank; disk: item -> bytes of the whole run; seconds of one step, as most of them are,
    and of the run. phases: what -> seconds of a step; sampling: seconds that the series takes in the whole run; start:
    seconds before the first step, with kernels from the cache.
    """

    memory: Mapping[str, float]
    disk: Mapping[str, float]
    step_seconds: float
    seconds: float
    phases: Mapping[str, float] = field(default_factory=dict)
    sampling: float = 0.0
    start: float = 0.0


def gain(ranks: int, threads: int, rates: Mapping[str, float], all_cores: float) -> float:
    """The speed-up of ranks x threads over one core in work that all cores of a node do `all_cores` times faster.

    On one node not more than it has; beyond twice its cores, nodes of the same kind. A gain that was measured while the
    machine changed may be none, or more than there are cores: it is taken for the nearest that can be.
    """
    wanted, node = ranks * threads, rates["cores"]
    all_cores = min(max(1.0, all_cores), node)
    used = min(wanted, node)
    one_node = 1 + (used - 1) * (all_cores - 1) / max(1.0, node - 1)
    return one_node * wanted / node if wanted > 2 * node else one_node


def writing_seconds(disk: Mapping[str, float], snapshots: int, rates: Mapping[str, float]) -> float:
    """Seconds of writing all files of a run: their bytes, and a constant for every snapshot."""
    return sum(disk.values()) / (1e9 * rates["disk_gb_s"]) + 1e-3 * snapshots * rates["snapshot_ms"]


FILES = {"disk_gb_s": 0.27, "snapshot_ms": 4.0}  # default rates of `writing_seconds`
