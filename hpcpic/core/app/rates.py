"""The measured rates of this machine, kept by `bench` and used by `estimate`."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from hpcpic.core.errors import FileError
from hpcpic.core.simd.caches import private_folder, private_path
from hpcpic.core.simd.registers import has_masks

FILE = "rates.json"  # beside the compiled kernels
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")
MEASURED = "bench {}"  # is kept by the bench of a program that has measured its kernels


def rates_file() -> Path:
    """Raises OSError."""
    return private_path(FILE)


def read_rates() -> dict[str, float]:
    """name -> rate measured on this host; {} when `bench` has not run here. What is no finite number of 0 or more was
    not measured.
    """
    try:
        there = rates_file().exists()  # a folder is not made to find nothing in it
        return _measured(json.loads(private_folder().read(FILE))[platform.node()]) if there else {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _measured(rates: Mapping[str, Any]) -> dict[str, float]:
    return {name: rate for name, rate in rates.items() if isinstance(rate, float | int) and 0 <= rate < math.inf}


def keep_rates(rates: Mapping[str, float]) -> Path:
    """Merge the rates into those of this host. Raises FileError."""
    try:
        folder = private_folder()
        try:
            content = json.loads(folder.read(FILE))
        except (OSError, ValueError):
            content = {}
        content = content if isinstance(content, dict) else {}
        content[platform.node()] = read_rates() | _measured(rates)
        folder.write(FILE, (json.dumps(content, indent=1) + "\n").encode())
    except OSError as error:
        raise FileError(f"cannot keep the rates: {error.filename}: {error.strerror}") from error
    return folder.path / FILE


def last_cache_mb(caches: Path = CACHES) -> float:
    """Size of the last-level cache, as the system tells it; 0 where it does not."""
    try:
        sizes = [path.read_text().strip() for path in caches.glob("index*/size")]
        return max((int(size.removesuffix("K")) * 1024e-6 for size in sizes), default=0.0)
    except (OSError, ValueError):
        return 0.0


def usual(wide: Mapping[str, float], narrow: Mapping[str, float]) -> dict[str, float]:
    """Rates of that machine of the authors which is most like this one: `wide` with AVX-512, and what is otherwise in
    `narrow` without it.
    """
    return dict(wide) | ({} if has_masks() else dict(narrow))


def undisturbed(seconds: Sequence[float]) -> float:
    """The median of repeated measurements, as a run tells that of its steps: what disturbs some of them does not count,
    a machine that is slow for most of them does.
    """
    return sorted(seconds)[len(seconds) // 2]


def in_turn(actions: Mapping[str, Callable[[], object]], rounds: int, calls: int = 4) -> dict[str, float]:
    """Seconds of a call of each action. They take turns of so many calls, of which the first finds cold caches and does
    not count: what slows the machine down for a while slows all of them, and their ratios and differences stay.
    """
    spent: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(rounds):
        for name, action in actions.items():
            for call in range(calls):
                begin = perf_counter()
                action()
                if call:
                    spent[name].append(perf_counter() - begin)
    return {name: undisturbed(times) for name, times in spent.items()}
