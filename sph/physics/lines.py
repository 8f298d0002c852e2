"""Lines and springs that hold a body; formulas for numbers, and compiled."""

from typing import Any

from hpcpic.core.simd.formulas import maximum, select


def tension(long: Any, growth: Any, stiffness: Any, length: Any, damping: Any, pushes: Any) -> Any:
    """Force in N of a spring and a dashpot in parallel, `long` m and growing by `growth` m/s; a line (pushes = 0) is
    slack where it is shorter than its length, and never pushes.
    """
    force = stiffness * (long - length) + damping * growth
    return select(pushes > 0.0, force, select(long > length, maximum(force, 0.0), 0.0))
