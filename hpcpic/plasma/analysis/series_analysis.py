"""Numbers out of series, snapshots and particles: pure functions of arrays, no files, no plots.

Times in s, positions in m, velocities in m/s, or all of them normalised alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

ROUND_OFF = 1e-14  # of a signal: what swings by less is noise of the arithmetic
RESOLVED = 1e-9  # of the largest amplitude: less may be the rounding of opposite charges that start without a field
STEADY = 0.25  # of a growth rate: one that is known worse is none, as where a wave that has started swings on
RISE = 1.0  # e-folds above all that the wave was before, without which it swings or is noise
SWINGS = 2.0  # times the wave's own swing that it must grow in
STILL = 0.3  # of a rate of decay: maxima that fall more slowly are noise


class NoFit(ValueError):
    """The signal does not show what the fit looks for; the message says what is missing."""


@dataclass(frozen=True, slots=True)
class Growth:
    """Exponential growth: value +- error in 1/s, fitted over [start, stop]; amplitude is that at t = 0."""

    value: float
    error: float
    start: float
    stop: float
    amplitude: float


@dataclass(frozen=True, slots=True)
class Oscillation:
    """amplitude exp(rate t) cos(frequency t + phase) + offset, with its standard errors and rms residual."""

    frequency: float
    rate: float
    amplitude: float
    phase: float
    offset: float
    frequency_error: float
    rate_error: float
    residual: float


def _line_windows(t: np.ndarray, y: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, ...]:
    """Least-squares lines over every [t[i], t[j]], i < j in ends: flat arrays i, j, slope, standard error."""
    t, y = t - t[0], y - y[0]
    sums = [np.concatenate(([0.0], np.cumsum(a))) for a in (np.ones_like(t), t, y, t * t, t * y, y * y)]
    a, b = np.triu_indices(len(ends), 1)
    i, j = ends[a], ends[b]
    n, st, sy, stt, sty, syy = (s[j + 1] - s[i] for s in sums)
    xx, xy, yy = stt - st * st / n, sty - st * sy / n, syy - sy * sy / n
    slope = xy / xx
    error = np.sqrt(np.maximum(yy - slope * xy, 1e-15 * yy) / np.maximum(n - 2, 1) / xx)
    return i, j, slope, error


def growth_rate(t: np.ndarray, amplitude: np.ndarray, efolds: float = 2.0) -> Growth:
    """Growth rate by a log-linear fit over the window that fixes the slope best.

    All windows before the maximum over which the amplitude grows by at least `efolds` (a third of its whole
    growth when that is more) are compared; the smallest relative standard error wins, which drops the noise
    before and the saturation after. A window that ends less than RISE above all that was before it, or is shorter
    than SWINGS of its swings, is a beat and does not count. The error adds half the spread of the slopes of the
    window's thirds: a bend either way, or one and back. Raises NoFit when nothing grows that much, or that steadily.
    """
    top = int(np.argmax(amplitude)) + 1
    positive = amplitude[:top] > RESOLVED * amplitude.max()
    t, y = t[:top][positive], np.log(amplitude[:top][positive])
    if t.size < 6:
        raise NoFit("no growth: fewer than six samples before the maximum")
    wanted = max(efolds, 0.33 * (y.max() - y.min()))
    ends = np.unique(np.linspace(0, t.size - 1, 80).astype(int))
    i, j, slope, error = _line_windows(t, y, ends)
    good = (slope * (t[j] - t[i]) >= wanted) & (j - i >= 5)
    if not good.any():
        raise NoFit(f"no growth by {wanted:.1f} e-folds")
    highest = np.concatenate(([-np.inf], np.maximum.accumulate(y)))  # before each sample
    swings = np.array([swing(t[:end], y[:end]) for end in ends])[np.searchsorted(ends, i)]
    good &= (y[j] >= highest[i] + RISE) & (t[j] - t[i] >= SWINGS * swings)
    if not good.any():
        raise NoFit("it grows at no steady rate: it swings, and does not rise above what it was before")
    best = np.flatnonzero(good)[np.argmin(error[good] / slope[good])]
    first, last = i[best], j[best]
    thirds = pairwise(np.linspace(first, last, 4).astype(int))
    slopes = [np.polyfit(t[a : b + 1] - t[a], y[a : b + 1], 1)[0] for a, b in thirds]
    start = np.exp(y[first : last + 1].mean() - slope[best] * t[first : last + 1].mean())
    whole_error = float(np.hypot(error[best], 0.5 * np.ptp(slopes)))
    if whole_error > STEADY * slope[best]:
        raise NoFit("it grows at no steady rate")
    return Growth(float(slope[best]), whole_error, float(t[first]), float(t[last]), float(start))


def swing(t: np.ndarray, y: np.ndarray) -> float:
    """The median time between maxima of a signal; 0 with fewer than three."""
    inner = y[1:-1]
    tops = t[1:-1][(inner > y[:-2]) & (inner >= y[2:])]
    return float(np.median(np.diff(tops))) if tops.size > 2 else 0.0


def _first_frequency(t: np.ndarray, y: np.ndarray) -> float:
    """Angular frequency of the highest line of the Hann-windowed spectrum, to a fraction of a bin."""
    n = len(y)
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(n))) + 1e-300
    p = int(np.argmax(power[1:-1])) + 1
    low, mid, high = np.log(power[p - 1 : p + 2])
    curve = low - 2.0 * mid + high
    shift = 0.5 * (low - high) / curve if curve < 0 else 0.0
    return 2.0 * np.pi * (p + shift) / (n * (t[1] - t[0]))


def _linearised(x: np.ndarray, y: np.ndarray, omega: float, rate: float, damped: bool) -> tuple[np.ndarray, ...]:
    """Best a, b, c of e^(rate x) (a cos + b sin)(omega x) + c; derivatives [n, 4 or 5] by these, omega (and rate); the
    residual [n].
    """
    envelope = np.exp(rate * x)
    c, s = envelope * np.cos(omega * x), envelope * np.sin(omega * x)
    basis = np.stack((c, s, np.ones_like(x)), axis=1)
    best = np.linalg.lstsq(basis, y, rcond=None)[0]
    a, b, _ = best
    columns = [basis, (x * (b * c - a * s))[:, None], (x * (a * c + b * s))[:, None]]
    return best, np.concatenate(columns[: 2 + damped], axis=1), y - basis @ best


def fit_oscillation(
    t: np.ndarray, y: np.ndarray, *, frequency: float | None = None, rate: float = 0.0, damped: bool = True
) -> Oscillation:
    """Least squares of a (damped) cosine with an offset, by Gauss and Newton on frequency and rate.

    Clean signals give the frequency to round-off. `frequency` in rad/s starts the iteration; without it the highest
    line of the spectrum does. Raises NoFit with fewer than eight samples, or when it does not settle.
    """
    t, y = np.asarray(t, float), np.asarray(y, float)
    if t.size < 8:
        raise NoFit("fewer than eight samples")
    middle, length = float(y.mean()), float(t[-1] - t[0])
    height = float(np.abs(y - middle).max())
    if not (length > 0.0 and height > ROUND_OFF * abs(middle)):
        raise NoFit("nothing swings")
    # Whatever the units, the columns of the problem have the same size: the solver drops those that are small.
    fit = _fit(t / length, (y - middle) / height, frequency and frequency * length, rate * length, damped)
    return replace(
        fit,
        frequency=fit.frequency / length,
        rate=fit.rate / length,
        amplitude=fit.amplitude * height,
        offset=middle + fit.offset * height,
        frequency_error=fit.frequency_error / length,
        rate_error=fit.rate_error / length,
        residual=fit.residual * height,
    )


def _fit(t: np.ndarray, y: np.ndarray, frequency: float | None, rate: float, damped: bool) -> Oscillation:
    """Fit an oscillation, as fit_oscillation does, to a signal of length and height 1."""
    origin = t[0]
    x = t - origin
    omega = frequency if frequency is not None else _first_frequency(x, y)
    scale = 1.0 / (x[-1] + 1e-300)
    for _ in range(100):
        (a, b, offset), jacobian, residual = _linearised(x, y, omega, rate, damped)
        step = np.linalg.lstsq(jacobian, residual, rcond=None)[0][3:]
        limit = np.minimum(1.0, scale / (np.abs(step) + 1e-300))  # at most a radian over the whole signal
        omega += step[0] * limit[0]
        rate += step[1] * limit[1] if damped else 0.0
        if np.abs(step).max() <= 1e-14 * abs(omega):
            break
    else:
        if np.abs(step).max() > 1e-6 * abs(omega):
            raise NoFit("the oscillation fit does not settle")
    freedom = max(t.size - jacobian.shape[1], 1)
    variance = (residual @ residual) / freedom * correlated(residual)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    phase = float(np.arctan2(-b, a) - omega * origin)
    height = float(np.hypot(a, b) * np.exp(-rate * origin))
    return Oscillation(
        float(abs(omega)),
        float(rate),
        height,
        phase,
        float(offset),
        float(np.sqrt(covariance[3, 3])),
        float(np.sqrt(covariance[4, 4])) if damped else 0.0,
        float(np.sqrt(residual @ residual / t.size)),
    )


def correlated(residual: np.ndarray) -> float:
    """Samples of a residual for each one that is independent: 1 + 2 times the sum of its autocorrelation up to where
    that is first negative; 1 of white noise.
    """
    n = residual.size
    power = np.abs(np.fft.rfft(residual, 2 * n)) ** 2
    covariance = np.fft.irfft(power, 2 * n)[:n]
    if not covariance[0] > 0.0:
        return 1.0
    alike = np.append(covariance / covariance[0], -1.0)
    return 1.0 + 2.0 * float(alike[1 : int(np.argmax(alike < 0.0))].sum())


def signed(amplitude: np.ndarray) -> np.ndarray:
    """The oscillation behind its absolute value: the sign turns at each minimum that reaches towards zero.

    Which side of a zero a sample belongs to is decided by the smaller fourth difference. A minimum counts
    when it lies below half of both neighbouring maxima.
    """
    y = np.asarray(amplitude, float)
    if y.size < 5:
        raise NoFit("fewer than five samples")
    inner = np.arange(1, y.size - 1)
    minima = inner[(y[inner] <= y[inner - 1]) & (y[inner] < y[inner + 1])]
    edges = np.concatenate(([0], minima, [y.size]))
    out, sign = y.copy(), 1.0
    weights = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    for m, left, right in zip(minima, edges[:-2], edges[2:], strict=True):
        if y[m] > 0.5 * min(y[left:m].max(), y[m + 1 : right].max()):
            out[m:] = sign * y[m:]
            continue
        sign = -sign
        out[m:] = sign * y[m:]
        first = min(max(m - 2, 0), y.size - 5)
        own = weights[m - first] * out[m]
        others = weights @ out[first : first + 5] - own
        if abs(others - own) < abs(others + own):
            out[m] = -out[m]
    return out


def peaks(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and heights of the maxima of |wave|, one per half period, by a parabola through three logs.

    Half periods are told apart by `signed`, so that ripples on a maximum do not count twice; a maximum at
    either end of the data is left out.
    """
    wave = signed(y)
    edges = np.concatenate(([0], np.flatnonzero(np.diff(np.sign(wave)) != 0) + 1, [y.size]))
    tops = [a + int(np.argmax(y[a:b])) for a, b in pairwise(edges) if b > a]
    i = np.array([top for top in tops if 0 < top < y.size - 1 and min(y[top - 1], y[top + 1]) > 0], int)
    low, mid, high = (np.log(y[i + s]) for s in (-1, 0, 1))
    curve = low - 2.0 * mid + high
    shift = np.where(curve < 0, 0.5 * (low - high) / np.where(curve < 0, curve, 1.0), 0.0)
    return t[i] + shift * (t[1] - t[0]), np.exp(mid - 0.25 * (low - high) * shift)


def noise_of(times: np.ndarray, heights: np.ndarray, rate: float) -> float:
    """Height of the noise that is left in the end of a wave that decays at about `rate` in 1/s: the median of the
    second half of the maxima, where these fall by STILL of that rate at most; 0 where the wave has not met it.
    """
    end, late = times[len(times) // 2 :], heights[len(times) // 2 :]
    if len(end) < 4 or np.polyfit(end - end[0], np.log(late), 1)[0] < STILL * rate:
        return 0.0
    return float(np.median(late))


def spectrum(field: np.ndarray, dt: float, dx: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(k[n_k], omega[n_w], power[n_w, n_k]) of field[t, x]: both directions of travel folded onto k >= 0.

    Hann window in time; the mean under that window is removed, so that a growing wave leaves nothing at omega = 0. A
    wave a cos(kx - wt) on a bin has power a^2/4. omega >= 0.
    """
    n_t, n_x = field.shape
    window = np.hanning(n_t + 1)[:-1]
    lines = np.fft.rfft(field - window @ field / window.sum(), axis=1) / n_x
    waves = np.fft.fft(lines * window[:, None], axis=0) / window.sum()
    power = np.abs(waves) ** 2
    half = n_t // 2 + 1
    folded = power[:half].copy()
    folded[1 : n_t - half + 1] += power[: half - 1 : -1]  # -omega; Nyquist has no partner
    return 2 * np.pi * np.fft.rfftfreq(n_x, dx), 2 * np.pi * np.arange(half) / (n_t * dt), folded


def velocity_distribution(
    v: np.ndarray, bins: int = 200, limits: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(centres, f) of v[n], with f dv integrated over the limits equal to the share of particles inside."""
    low, high = limits or (float(v.min()), float(v.max()))
    if high <= low:
        low, high = low - 0.5, low + 0.5
    counts, edges = np.histogram(v, bins=bins, range=(low, high))
    return 0.5 * (edges[1:] + edges[:-1]), counts / (v.size * np.diff(edges))


def phase_space(
    x: np.ndarray, v: np.ndarray, length: float, bins: tuple[int, int], limits: tuple[float, float]
) -> np.ndarray:
    """f[v, x]: particles per bin over [0, length) x limits."""
    return np.histogram2d(v, x, bins=(bins[1], bins[0]), range=(limits, (0.0, length)))[0]


def temperature(v: np.ndarray, mass: float) -> np.ndarray:
    """Temperature in J of each component of v[n, d] about its mean: m var(v)."""
    return mass * np.asarray(v).var(axis=0)


def relative_drift(values: np.ndarray, scale: float | None = None) -> np.ndarray:
    """(values - values[0])/scale, with |values[0]| unless given; a zero scale leaves the plain difference."""
    scale = abs(values[0]) if scale is None else scale
    return (values - values[0]) / (scale or 1.0)


def conservation(series: Mapping[str, np.ndarray], momentum_scale: float = 0.0) -> dict[str, float]:
    """Largest departures: charge and total energy relative to their start, momentum to `momentum_scale`."""
    found = {}
    for name, scale in (
        ("charge", None),
        ("energy_total", None),
        ("momentum_x", momentum_scale),
        ("momentum_y", momentum_scale),
    ):
        if name in series:
            found[name] = float(np.abs(relative_drift(np.asarray(series[name]), scale)).max())
    return found
