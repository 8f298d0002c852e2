"""Measurements that the cases are compared with, read off published figures."""

import numpy as np
from numpy.typing import NDArray

from sph.analysis import theory

# Koshizuka & Oka 1996, Nucl. Sci. Eng. 123: front of a column L x 2 L, L = 0.146 m: t sqrt(2 g / L), x / L; digitised.
KOSHIZUKA_FRONT = np.array([
    (0.0, 1.0), (0.381, 1.111), (0.769, 1.252), (1.153, 1.505), (1.537, 1.892), (1.935, 2.241), (2.323, 2.615),
    (2.719, 3.003), (3.096, 3.624),
])  # fmt: skip

# Lobovsky et al. 2014, J. Fluids Struct. 48: pressure 3 mm above the floor, H = 0.3 m: t sqrt(g / H), p / (rho g H);
# digitised, thinned where nothing happens.
LOBOVSKY_PRESSURE = np.array([
    (0.081, 0.023), (0.909, 0.008), (1.736, 0.006), (2.232, 0.015), (2.382, 0.004), (2.427, 0.364), (2.435, 1.612),
    (2.435, 1.973), (2.45, 2.843), (2.45, 2.499), (2.498, 2.04), (2.564, 1.953), (2.63, 1.725), (2.675, 1.551),
    (2.758, 1.335), (2.829, 1.202), (2.924, 1.062), (3.089, 0.883), (3.17, 0.832), (3.255, 0.775), (3.42, 0.718),
    (3.585, 0.689), (3.751, 0.707), (3.916, 0.644), (4.082, 0.599), (4.247, 0.555), (4.413, 0.559), (4.578, 0.532),
    (4.743, 0.578), (4.909, 0.607), (5.074, 0.573), (5.24, 0.531), (5.405, 0.544), (5.571, 0.579), (5.736, 0.621),
    (5.901, 0.793), (5.974, 0.909), (6.067, 0.816), (6.232, 0.839), (6.307, 0.794), (6.398, 0.824), (6.495, 0.79),
    (6.563, 0.766), (6.649, 0.696), (6.729, 0.7), (6.886, 0.651), (6.982, 0.618),
])  # fmt: skip

# Buchner 2002, PhD thesis, TU Delft: pressure on his sensor 1, H = 0.6 m, as TrixiParticles.jl has it (validation/
# dam_break_2d): t sqrt(g / H), p / (rho g H); digitised, thinned.
BUCHNER_PRESSURE = np.array([
    (2.025, -0.018), (2.168, 0.011), (2.426, -0.015), (2.473, 0.077), (2.491, 0.154), (2.553, 0.265), (2.616, 0.371),
    (2.623, 0.463), (2.65, 0.562), (2.689, 0.662), (2.835, 0.672), (2.961, 0.646), (3.132, 0.579), (3.368, 0.541),
    (3.52, 0.545), (3.679, 0.541), (3.905, 0.544), (4.06, 0.556), (4.223, 0.558), (4.355, 0.555), (4.57, 0.543),
    (4.72, 0.538), (4.917, 0.513), (5.038, 0.514), (5.159, 0.514), (5.304, 0.526), (5.445, 0.549), (5.586, 0.588),
    (5.75, 0.656), (5.806, 0.716), (5.814, 0.832), (5.816, 0.742), (5.833, 0.877), (5.882, 0.798), (5.921, 0.724),
    (5.968, 0.648), (6.051, 0.579), (6.222, 0.556), (6.32, 0.618), (6.36, 0.562), (6.423, 0.497), (6.561, 0.468),
    (6.707, 0.522), (6.88, 0.417), (7.001, 0.438), (7.109, 0.493), (7.183, 0.44), (7.299, 0.416),
])  # fmt: skip

# Yeh & Petroff, University of Washington (SPHERIC test 1): force on the column along the tank, t in s (shifted by
# Silvester & Cleary 2006, figure 4, to go with their case F), N; medians over 10 to 50 ms of several repeats.
COLUMN_FORCE = np.array([
    (0.023, -1.2), (0.082, 0.2), (0.125, -0.1), (0.179, -0.1), (0.23, -0.6), (0.284, -0.1), (0.308, 0),
    (0.316, -0.4), (0.323, -0.1), (0.335, 0.2), (0.343, 2.1), (0.355, 8), (0.366, 15.5), (0.375, 21.3),
    (0.384, 26.2), (0.394, 32), (0.407, 32), (0.414, 33.3), (0.428, 30.6), (0.437, 28.6), (0.445, 24.6),
    (0.456, 24), (0.468, 22.2), (0.476, 21.5), (0.486, 19.9), (0.496, 18.9), (0.512, 19.5), (0.538, 19.1),
    (0.564, 18.4), (0.593, 18.2), (0.61, 17.4), (0.639, 17.7), (0.663, 17.7), (0.683, 17.6), (0.711, 17),
    (0.738, 16.6), (0.757, 16.3), (0.788, 15.5), (0.821, 15.3), (0.842, 15.4), (0.86, 14.5), (0.889, 13.4),
    (0.911, 12.4), (0.928, 11.9), (0.96, 10.6), (0.994, 9.5), (1.015, 8.4), (1.042, 7.6), (1.063, 8.4), (1.09, 7),
    (1.11, 6.3), (1.14, 5.6), (1.163, 4.8), (1.19, 5), (1.22, 4.4), (1.24, 3.9), (1.285, 3.7), (1.32, 3),
    (1.34, -0.7), (1.365, 0.5), (1.39, -3.2), (1.417, 0.3), (1.437, -0.8), (1.462, -2.8), (1.487, -6.7),
    (1.515, -9.3), (1.54, -10.6), (1.565, -10.3), (1.588, -9.7), (1.616, -8), (1.637, -8.8), (1.665, -7.9),
    (1.69, -7.4), (1.715, -6.9), (1.742, -7.1), (1.767, -6.3), (1.793, -7.2), (1.812, -5.7), (1.84, -5),
    (1.87, -4.3), (1.893, -3.9), (1.915, -4.1), (1.94, -3.2), (1.965, -2.7), (1.98, -2.4), (2.024, -1.6),
    (2.07, -1.3), (2.117, -1), (2.168, -0.8), (2.216, -0.2), (2.267, -0.3), (2.32, -0.6), (2.37, -1),
    (2.414, -1.2), (2.475, -1.9), (2.52, -2.2), (2.566, -2.5), (2.615, -1.8), (2.671, -2.6), (2.717, -2.8),
    (2.764, -1.4), (2.823, -1.8), (2.872, -1.6), (2.923, -0.7), (2.968, -0.8),
])  # fmt: skip

PRESSURE_RISE = 0.2  # rho g H, where the clock of a dam break behind a gate is laid beside that of an experiment
COLUMN_SHIFT = 0.068  # s: the clock of the experiment is arbitrary; this makes it arrive with our case F (5 mm)
COLUMN_RISE, COLUMN_PLATEAU, COLUMN_END = 8.0, (0.55, 0.75), 1.3  # N that is an arrival; s of the experiment's clock


def passing(t: NDArray, values: NDArray, level: float) -> float:
    """When a reading first rises beyond a level: where the clocks of a run and of an experiment are laid together."""
    k = max(1, int(np.argmax(values > level)))
    return float(np.interp(level, values[k - 1 : k + 1], t[k - 1 : k + 1]))


def column_figures(t: NDArray, impulse: NDArray) -> dict[str, float]:
    """Peak in N, arrival in s and plateau in N of the force on the column, filtered over 13 ms, and its impulse in N s
    until 1.3 s, from samples of the impulse of a run; all by the experiment's clock. NaN where the run is too short.
    """
    t = t + COLUMN_SHIFT
    middle, force = theory.mean_rate(t, impulse)
    force = theory.triangular(middle, force)
    return _figures(middle, force) | {"impulse": float(np.interp(COLUMN_END, t, impulse, right=np.nan))}


def _figures(t: NDArray, force: NDArray) -> dict[str, float]:
    level = (t > COLUMN_PLATEAU[0]) & (t < COLUMN_PLATEAU[1])
    plateau = np.trapezoid(force[level], t[level]) / np.ptp(t[level]) if t[-1] > COLUMN_PLATEAU[1] else np.nan
    return {"peak": float(force.max()), "arrival": passing(t, force, COLUMN_RISE), "plateau": float(plateau)}


COLUMN_FIGURES = _figures(*COLUMN_FORCE.T) | {
    "impulse": float(np.interp(COLUMN_END, COLUMN_FORCE[:, 0], theory.cumulative(*COLUMN_FORCE.T)))
}
