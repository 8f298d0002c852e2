"""Cores that a machine allots to a run: threads beyond them wait for each other."""

import math
import os

from hpcpic.core import memory
from hpcpic.core.memory import read_text


def allotted(among: int | None = None) -> int:
    """Cores of this machine that a run may use: those that this process may use, or `among`, and no more than the
    control groups (container, batch job) give time of.
    """
    return max(1, math.floor(min([among or len(os.sched_getaffinity(0)), *_quotas()])))


def _quotas() -> list[float]:
    """Seconds of cores in a second that the control groups around this process give, of those that limit it."""
    found = []
    for controller, folder in memory.groups():
        if controller == "":
            quota, _, period = read_text(folder / "cpu.max").strip().partition(" ")
        elif "cpu" in controller.split(","):
            quota, period = (read_text(folder / f"cpu.cfs_{name}_us").strip() for name in ("quota", "period"))
        else:
            continue
        if quota.isdigit() and period.isdigit():  # neither "max" nor -1
            found.append(int(quota) / int(period))
    return found


def crowded(ranks: int, threads: int, cores: int) -> str:
    """A sentence where so many ranks on a machine want more cores than it allots; "" where there are enough."""
    if ranks * threads <= cores:
        return ""
    shape = f"{ranks} rank{'s' * (ranks > 1)} x {threads} thread{'s' * (threads > 1)}"
    return (
        f"{shape} want {ranks * threads} cores, and this machine allots {cores}: they wait for each other, and take "
        f"longer than {cores} would"
    )
