"""What theory says of the shipped cases, and how measured series are reduced."""

import math

import numpy as np
from numpy.typing import NDArray

FILTER = 0.013  # s, of (SC)


def poiseuille(z: NDArray, t: float, force: float, nu: float, width: float, terms: int = 60) -> NDArray[np.float64]:
    """v(z, t) of (MP 24), with the signs that make the flow follow the force; z from one plane, F in m/s2."""
    steady = force / (2 * nu) * z * (width - z)
    n = 2 * np.arange(terms) + 1.0
    decay = np.exp(-((n * math.pi / width) ** 2) * nu * t)
    waves = 4 * force * width**2 / (nu * math.pi**3 * n**3) * decay
    return steady - np.sin(np.outer(z, n) * math.pi / width) @ waves


def poiseuille_stress(
    z: NDArray, t: float, force: float, nu: float, width: float, density: float, terms: int = 60
) -> NDArray[np.float64]:
    """rho nu dv/dz of `poiseuille`, Pa."""
    n = 2 * np.arange(terms) + 1.0
    decay = np.exp(-((n * math.pi / width) ** 2) * nu * t)
    waves = 4 * force * width / (nu * math.pi**2 * n**2) * decay
    slope = force / (2 * nu) * (width - 2 * z) - np.cos(np.outer(z, n) * math.pi / width) @ waves
    return density * nu * slope


def drop_axes(t: NDArray, rate: float, radius: float) -> tuple[NDArray, NDArray]:
    """Semi-axes a (shrinking), b of the drop of Monaghan 1994: v = (-A x, A y) with A' = A^2 (a^2 - b^2)/(a^2 + b^2),
    integrated by RK4.
    """

    def rates(y: NDArray) -> NDArray:
        a, b, shear = y
        return np.array([-shear * a, shear * b, shear**2 * (a * a - b * b) / (a * a + b * b)])

    end, steps = float(np.max(t, initial=0.0)), 2000
    dt = end / steps
    y = np.array([radius, radius, rate])
    found = [y]
    for _ in range(steps):
        k1 = rates(y)
        k2 = rates(y + dt / 2 * k1)
        k3 = rates(y + dt / 2 * k2)
        y = y + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rates(y + dt * k3))
        found.append(y)
    times, path = np.linspace(0.0, end, steps + 1), np.array(found)
    return np.interp(t, times, path[:, 0]), np.interp(t, times, path[:, 1])


def wave_frequency(k: float, depth: float, g: float) -> float:
    """omega of a linear gravity wave, rad/s."""
    return math.sqrt(g * k * math.tanh(k * depth))


def wave_number(omega: float, depth: float, g: float) -> float:
    """k of a linear gravity wave of frequency omega, rad/m, by Newton's method."""
    k = omega**2 / g / math.sqrt(math.tanh(omega**2 * depth / g))
    for _ in range(30):
        t = math.tanh(k * depth)
        k -= (g * k * t - omega**2) / (g * t + g * k * depth * (1 - t * t))
    return k


def wavemaker_height(stroke: float, k: float, depth: float) -> float:
    """Height of the waves of a piston of this stroke (linear theory)."""
    x = 2 * k * depth
    return stroke * 2 * (math.cosh(x) - 1) / (math.sinh(x) + x)


def jet_on_plate(width: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a plane jet without gravity, `width` times as wide as the plate that it strikes at right angles, does to it:
    places from the middle (0) to the edge (1), and the pressure there over rho U^2 / 2, 1 at the middle and 0 at the
    edge, where the free streamlines leave with the speed U (Lamb 1932, chapter 4; in the hodograph, w is a source at U
    and two sinks at U exp(+-i a), where the jet goes to). ValueError below a width of 0.2: it leaves along the plate.
    """
    if width < 0.2:
        raise ValueError(f"a jet {width:g} times as wide as the plate leaves along it: 0.2 at least")
    speed = np.linspace(0.0, 1.0, 4001)  # along the plate, over U
    square = speed * speed

    def places(a: float) -> NDArray:
        """Over the width of the jet."""
        twice = math.cos(2 * a)
        slope = 2 / (1 + square) - 2 * (square + twice) / (square * square + 2 * square * twice + 1)
        return cumulative(speed, slope) / math.pi

    low, high = 0.0, math.pi / 2
    for _ in range(60):
        a = (low + high) / 2
        low, high = (low, a) if 2 * places(a)[-1] > 1 / width else (a, high)
    y = places((low + high) / 2)
    return y / y[-1], 1 - square


def cushioned_fall(
    t: NDArray, mass: float, below: float, above: float, ambient: float, g: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far water of a mass per area, kg/m2, that is let go between two layers of air `below` and `above`, m, in a
    closed shaft has fallen, m, and the pressure in the air below it over the ambient one, Pa (Bagnold 1939): m s'' =
    m g - p_below + p_above with p + ambient = ambient (thickness at rest / thickness)^1.4. By velocity Verlet.
    """

    def pressures(s: float) -> tuple[float, float]:
        return ambient * ((below / (below - s)) ** 1.4 - 1), ambient * ((above / (above + s)) ** 1.4 - 1)

    def acceleration(s: float) -> float:
        under, over = pressures(s)
        return g - (under - over) / mass

    times = np.linspace(0.0, float(np.max(t, initial=0.0)), 20001)
    dt, s, v = times[1], 0.0, 0.0
    a, way, pressure = acceleration(s), [s], [0.0]
    for _ in times[1:]:
        v += a * dt / 2
        s += v * dt
        a = acceleration(s)
        v += a * dt / 2
        way.append(s)
        pressure.append(pressures(s)[0])
    return np.interp(t, times, way), np.interp(t, times, pressure)


def triangular(t: NDArray, values: NDArray, width: float = FILTER) -> NDArray[np.float64]:
    """Two-sided moving average with triangular weights over `width` s, for any sample times.

    Weights are those of the time between samples, so an uneven step does not tilt the average.
    """
    share = np.gradient(t) if len(t) > 1 else np.ones_like(t)
    first = np.searchsorted(t, t - width / 2)
    last = np.searchsorted(t, t + width / 2, side="right")
    found = np.empty_like(values, dtype=float)
    for k, (a, b) in enumerate(zip(first, last)):
        weight = (1 - np.abs(t[a:b] - t[k]) / (width / 2)).clip(0.0) * share[a:b]
        found[k] = weight @ values[a:b] / weight.sum() if weight.sum() > 0 else values[k]
    return found


def cumulative(t: NDArray, values: NDArray) -> NDArray[np.float64]:
    """Integral from the first sample by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * (values[1:] + values[:-1]) / 2)])


def mean_rate(t: NDArray, integral: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles of the intervals between samples and the mean rate in each: a force from its impulse, of every step."""
    return (t[1:] + t[:-1]) / 2, np.diff(integral) / np.diff(t)


def period_of(t: NDArray, values: NDArray) -> float:
    """Mean time between upward crossings of the mean, linear between samples; NaN with fewer than two."""
    y = values - values.mean()
    up = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    times = t[up] - y[up] * (t[up + 1] - t[up]) / (y[up + 1] - y[up])
    return float(np.diff(times).mean()) if len(times) > 1 else math.nan
