"""Quantities of interest out of the columns of a series: `mean(force_x, from=0.5)`, and what is zero by symmetry.

A reduction is a function of times[n] s and values[n] within a window; it gives one number or a vector.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.app.knobs import Knobs, Quantity
from hpcpic.core.errors import ConfigError

if TYPE_CHECKING:
    from hpcpic.core.files.series import Series

CURVE = 17  # times of a curve
BLOCKS = 8  # of a window, for the interval of a mean
STUDENT = 2.447  # of BLOCKS - 2 degrees of freedom, 95 %
AT_REST = 1e-20  # of the largest kinetic energy: speeds of 1e-10, far above rounding (1e-16) and below any wave
BY_SYMMETRY = 1e-3  # of the size that a column of this kind has in the scene
GRAMMAR = "REDUCTION(COLUMN) or REDUCTION(COLUMN, from=T, to=T)"
FORM = re.compile(r"\s*(\w+)\(\s*([\w.+-]+)\s*((?:,\s*(?:from|to)\s*=\s*[-+\d.eE]+\s*)*)\)\s*")


@dataclass(frozen=True, slots=True)
class Reduction:
    """measure(t[n], y[n]) over the window, which by default begins at `start` of its end."""

    text: str
    measure: Callable[[NDArray, NDArray], NDArray | float]
    start: float = 0.5


def mean(t: NDArray, y: NDArray) -> float:
    return float(np.trapezoid(y, t) / (t[-1] - t[0]))


def rms(t: NDArray, y: NDArray) -> float:
    return math.sqrt(mean(t, y * y))


def last(t: NDArray, y: NDArray) -> float:
    return float(y[-1])


def curve(t: NDArray, y: NDArray) -> NDArray:
    """At the same times of every run."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, y)(np.clip(np.linspace(t[0], t[-1], CURVE), t[0], t[-1]))


def growth(t: NDArray, y: NDArray) -> float:
    """Slope of log |y|, 1/s."""
    return float(np.polyfit(t - t[0], np.log(np.maximum(np.abs(y), 1e-300)), 1)[0])


def even(t: NDArray, y: NDArray) -> tuple[float, NDArray]:
    """(time step, values at equal times)."""
    times = np.linspace(t[0], t[-1], len(t))
    return float(times[1] - times[0]), np.interp(times, t, y)


def peak(t: NDArray, y: NDArray) -> float:
    """Frequency of the highest peak of the spectrum, 1/s: Hann's window, a parabola through the logs of three lines."""
    dt, y = even(t, y)
    if not np.ptp(y) > 1e-12 * np.abs(y).max():
        raise ValueError("no oscillation")
    spectrum = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(len(y)), 4 * len(y)))
    k = int(np.argmax(spectrum[1:-1])) + 1
    a, b, c = np.log(np.maximum(spectrum[k - 1 : k + 2], 1e-300))
    return float(k + 0.5 * (a - c) / (a - 2 * b + c)) / (4 * len(y) * dt)


def oscillation(t: NDArray, y: NDArray) -> tuple[float, float]:
    """(frequency 1/s, damping rate 1/s) of offset + exp(-rate t) (a + cos(2 pi frequency t + phase)), by least squares:
    an energy, the square of a wave, has the part a.
    """
    found = [fitted(t - t[0], y, start) for start in (peak(t, y), peak(t, np.gradient(y, t)))]  # above a trend
    near = [one for one in found if 0.3 * one[3] < one[1] < 3.0 * one[3]]
    if not near:
        raise ValueError("no oscillation")
    return min(near)[1:3]


def fitted(t: NDArray, y: NDArray, start: float) -> tuple[float, float, float, float]:
    """(remaining squares, frequency 1/s, damping rate 1/s, start) of an oscillation sought from `start` 1/s."""
    from scipy.optimize import least_squares

    def residual(x: NDArray) -> NDArray:
        wave, decay = 2.0 * math.pi * x[0] * start * t, np.exp(-np.clip(x[1] * start * t, -30.0, 30.0))
        basis = np.stack([np.ones_like(t), decay, decay * np.cos(wave), decay * np.sin(wave)], axis=1)
        return basis @ np.linalg.lstsq(basis, y, rcond=None)[0] - y

    made = least_squares(residual, [1.0, 0.01], x_scale=[0.1, 0.1])
    return float(made.cost), float(made.x[0] * start), float(made.x[1] * start), start


REDUCTIONS = {
    "mean": Reduction("mean", mean),
    "min": Reduction("least value", lambda t, y: float(y.min()), 0.0),
    "max": Reduction("largest value", lambda t, y: float(y.max()), 0.0),
    "last": Reduction("value", last),
    "curve": Reduction("values", curve),
    "norm": Reduction("root of the mean square", rms),
    "frequency": Reduction("frequency of a fitted oscillation, 1/s,", lambda t, y: oscillation(t, y)[0], 0.0),
    "damping": Reduction("damping rate of a fitted oscillation, 1/s,", lambda t, y: oscillation(t, y)[1], 0.0),
    "growth": Reduction("growth rate, 1/s,", growth),
    "peak": Reduction("frequency of the highest peak of the spectrum, 1/s,", peak, 0.0),
}


def parsed(text: str, columns: list[str], knobs: Knobs) -> Quantity:
    """The quantity that `--qoi` describes, of columns of the series. Raises ConfigError."""
    found = FORM.fullmatch(text)
    named = ", ".join(quantity.name for quantity in knobs.quantities())
    if not found or found[1] not in REDUCTIONS:
        raise ConfigError(
            f"--qoi {text}: expected {GRAMMAR}, with one of {', '.join(REDUCTIONS)}; or one of {named}, field"
        )
    name, column = found[1], found[2]
    if column not in columns:
        raise ConfigError(f"--qoi {text}: there is no column {column}; there are {', '.join(columns)}")
    reduction, end = REDUCTIONS[name], knobs.time
    try:
        window = {key.strip(): float(value) for key, value in re.findall(r"(from|to)\s*=\s*([-+\d.eE]+)", found[3])}
    except ValueError:
        raise ConfigError(f"--qoi {text}: from and to are times in s") from None
    until = window.get("to", end)
    first = window.get("from", reduction.start * until)
    if not 0.0 <= first < until <= end * (1.0 + 1e-9):
        raise ConfigError(f"--qoi {text}: from {first:g} to {until:g} s is no part of the run, 0 to {end:g} s")
    place = f"at t = {until:.4g} s" if name == "last" else f"from t = {first:.4g} to {until:.4g} s"
    return Quantity(
        text.replace(" ", ""),
        f"{reduction.text} of {column} {place}",
        until,
        partial(reduced, column, reduction.measure, first, until),
        column=column,
        asked=True,
        noise=partial(interval, column, first, until) if name in ("mean", "norm") else None,
    )


def windowed(series: Series, column: str, first: float, until: float) -> tuple[NDArray, NDArray]:
    """(t, y) of a column in [first, until], with its ends; raises ValueError where it has no values there."""
    known = np.isfinite(series[column])
    t, y = series.time[known], series[column][known]
    if len(t) < 8 or t[-1] < until - 2.0 * (t[-1] - t[-2]):
        raise ValueError(f"{column} has {len(t)} samples, the last at t = {t[-1] if len(t) else 0:.4g} s")
    margin = 1e-9 * (until - first)  # samples at the ends but for rounding are the ends
    inside = (t > first + margin) & (t < until - margin)
    ends = np.array([first, until])
    return np.insert(ends, 1, t[inside]), np.insert(np.interp(ends, t, y), 1, y[inside])


def reduced(column: str, measure: Callable, first: float, until: float, series: Series) -> NDArray | float:
    return measure(*windowed(series, column, first, until))


def at_end(column: str, time: float, series: Series) -> float:
    return float(np.interp(time, series.time, series[column]))


def grown(energy: NDArray) -> float:
    """Largest kinetic energy over that at the start; what starts at rest, but for rounding, is watched by the guards of
    the run.
    """
    if not np.isfinite(energy).all():
        return math.inf
    return float(energy.max() / energy[0]) if energy[0] > AT_REST * energy.max() else 1.0


def interval(column: str, first: float, until: float, series: Series) -> float:
    """Half the 95 % interval of the mean over the window, by the means of BLOCKS parts of it about their own trend: a
    decay or a growth is no noise.
    """
    t, y = windowed(series, column, first, until)
    blocks, k = np.array([part.mean() for part in np.array_split(even(t, y)[1], BLOCKS)]), np.arange(BLOCKS)
    about = blocks - np.polyval(np.polyfit(k, blocks, 1), k)
    return STUDENT * math.sqrt(float((about**2).sum()) / (BLOCKS - 2) / BLOCKS)


# --------------------------------------------------------------------------------------- zero by symmetry


def natural_size(series: Series, column: str) -> float:
    """The size that a column of this kind has in the scene: of all components of its vector, for a momentum that of
    all mass at the speed that the kinetic energy gives too. 0 where nothing says it.
    """
    stem, axis = column[:-2], column[-2:]
    if axis not in ("_x", "_y", "_z"):
        return 0.0
    vector = [series[stem + a] for a in ("_x", "_y", "_z") if stem + a in series]
    size = max(float(np.nanmax(np.abs(component), initial=0.0)) for component in vector)
    if stem == "momentum" and "mass" in series and "energy_kinetic" in series:
        moved = 2.0 * np.nanmax(series["mass"]) * np.nanmax(series["energy_kinetic"], initial=0.0)
        size = max(size, math.sqrt(max(moved, 0.0)))
    return size


def is_nothing(series: Series, column: str) -> bool:
    """True if a column is zero, or as small beside what it could be as only symmetry makes it."""
    values = np.abs(series[column][np.isfinite(series[column])])
    largest = float(values.max(initial=0.0))
    return largest <= BY_SYMMETRY * natural_size(series, column) or largest == 0.0


def telling(series: Series) -> list[str]:
    """Columns that are not zero by symmetry, and change."""
    return [
        name for name, values in series.items()
        if not is_nothing(series, name) and np.ptp(values[np.isfinite(values)]) > 1e-9 * np.nanmax(np.abs(values))
    ]  # fmt: skip
