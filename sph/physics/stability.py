"""How long a step may be: von Neumann's analysis of the discrete SPH operators on a lattice.

A wave exp(i k.r) of density r and velocity u along k obeys r' = -l r - i a u, u' = -i a r - n u. Acoustic frequency a,
decay rate l of the density flux and n of viscosity are sums over the neighbours of a lattice point; in units of c0 / h
they depend on dimension, kernel, h / dp and coefficients only. A step is stable while no wave grows.
"""

import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sph.case.config import SphConfig

GROWTH = 1e-3  # per step, that counts as stable: an explicit run is short beside 1 / GROWTH steps of growth
WAVES = 24  # wave numbers per direction
VISCOUS = 0.125  # of h^2 / nu: the customary viscous limit
DECAY = {"euler": 2.0, "predictor-corrector": 1.0, "rk3-tvd": 2.51, "symplectic": 2.0}  # most decay per step
LONG = 40  # particles to half a wave that counts as long
FORCE = 0.25  # of sqrt(h / acceleration)
PHYSICAL = ("strain-rate", "cleary", "morris")  # forms of the viscosity of the fluid
TOP = 4.0  # Courant numbers looked at

_NORMS = {
    "cubic": (15 / (7 * np.pi), 3 / (2 * np.pi)),
    "wendland2": (7 / (4 * np.pi), 21 / (16 * np.pi)),
    "wendland4": (9 / (4 * np.pi), 495 / (256 * np.pi)),
    "quintic": (7 / (478 * np.pi), 1 / (120 * np.pi)),
}


def value(kernel: str, q: NDArray, d: int) -> NDArray[np.float64]:
    """h^d W at q = r / h."""
    t, u, v = (np.maximum(0.0, n - q) for n in (1, 2, 3))
    w = np.maximum(0.0, 1 - q / 2)
    shape = {
        "cubic": lambda: (u**3 - 4 * t**3) / 6,
        "wendland2": lambda: w**4 * (2 * q + 1),
        "wendland4": lambda: w**6 * (1 + 3 * q + 35 / 12 * q * q),
        "quintic": lambda: v**5 - 6 * u**5 + 15 * t**5,
    }[kernel]
    return _NORMS[kernel][d - 2] * shape()


def slope(kernel: str, q: NDArray, d: int) -> NDArray[np.float64]:
    """-h^(d+1) dW/dr at q = r / h."""
    t, u, v = (np.maximum(0.0, n - q) for n in (1, 2, 3))
    w = np.maximum(0.0, 1 - q / 2)
    shape = {
        "cubic": lambda: (u * u - 4 * t * t) / 2,
        "wendland2": lambda: 5 * q * w**3,
        "wendland4": lambda: (14 * q + 35 * q * q) / 3 * w**5,
        "quintic": lambda: 5 * (v**4 - 6 * u**4 + 15 * t**4),
    }[kernel]
    return _NORMS[kernel][d - 2] * shape()


def neighbourhood(kernel: str, d: int, smoothing: float) -> tuple[NDArray, NDArray, NDArray]:
    """r[n, d] in h and |r| of the neighbours of a lattice point, and V F with F = -W' / r, in units of 1 / h^2."""
    reach = int(np.ceil(3 * smoothing))
    r = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1.0)] * d), axis=-1).reshape(-1, d) / smoothing
    r = r[np.any(r != 0, axis=1)]
    distance = np.sqrt(np.sum(r * r, axis=1))
    return r, distance, slope(kernel, distance, d) / distance * smoothing**-d


@functools.lru_cache(maxsize=64)
def cleary_constant(kernel: str, d: int, smoothing: float) -> float:
    """xi of (SC 6), calibrated as Cleary did with a shear flow: a long shear wave along an axis of the lattice decays
    with the viscosity asked for. (Cubic spline, 2D, h/dp = 1.2: 5.1, Cleary 4.963; dense neighbours: d + 2, which is
    also taken where the support does not reach across the diagonal of a square, so that no constant would do.)
    """
    r, distance, f = neighbourhood(kernel, d, smoothing)
    k = np.pi / LONG * smoothing
    shear = np.sum(f * r[:, 0] ** 2 / (distance**2 + 0.01) * (1 - np.cos(k * r[:, 1]))) / k**2
    return float(1 / (2 * shear)) if shear > 0 else d + 2.0


@functools.lru_cache(maxsize=64)
def rates(kernel: str, d: int, smoothing: float) -> dict[str, NDArray[np.float64]]:
    """Of waves along axis, face and space diagonals, in units of c0 / h: `acoustic`; and per unit of coefficient
    `rusanov`, `molteni`, `delta`, `artificial`; per unit of nu / (c0 h) `strain-rate`, `cleary` and `morris`.
    """
    r, distance, f = neighbourhood(kernel, d, smoothing)
    directions = [np.array([1.0] * n + [0.0] * (d - n)) for n in range(1, d + 1)]
    k = np.concatenate([np.outer(np.arange(1, WAVES + 1) / WAVES, e) for e in directions]) * np.pi * smoothing
    phase = k @ r.T
    damping, along = 1 - np.cos(phase), (k @ r.T / np.sqrt(np.sum(k * k, axis=1))[:, None] / distance) ** 2
    gradient = np.sin(phase) @ (f[:, None] * r)
    square = np.sum(gradient * gradient, axis=1)
    laplacian = 2 * damping @ f
    pairs = (damping * along) @ f
    return {
        "acoustic": np.sqrt(square),
        "rusanov": damping @ (f * distance),
        "molteni": laplacian,
        "fourtakas": laplacian,
        "delta": np.maximum(0.0, laplacian - square),
        "none": np.zeros_like(square),
        "artificial": pairs,
        "strain-rate": square,
        "morris": laplacian,
        "cleary": 2 * cleary_constant(kernel, d, smoothing) * pairs,
    }


def amplification(integrator: str, a: NDArray, l: NDArray, n: NDArray, z: float) -> NDArray[np.float64]:
    """Largest |eigenvalue| of one step of Courant number z, over all waves."""
    m = z * np.stack([np.stack([-l + 0j, -1j * a], -1), np.stack([-1j * a, -n + 0j], -1)], -2)
    one = np.eye(2)
    if integrator == "euler":
        step = one + m
    elif integrator == "predictor-corrector":
        step = one + m + m @ m
    elif integrator == "rk3-tvd":
        step = one + m + m @ m / 2 + m @ m @ m / 6
    else:  # velocity first, then density with the new velocity
        kick = np.broadcast_to(one, m.shape).copy().astype(complex)
        kick[..., 1, :] += m[..., 1, :]
        drift = np.broadcast_to(one, m.shape).copy().astype(complex)
        drift[..., 0, :] += m[..., 0, :]
        step = drift @ kick
    trace, determinant = step[..., 0, 0] + step[..., 1, 1], np.linalg.det(step)
    root = np.sqrt(trace * trace / 4 - determinant)
    return np.maximum(np.abs(trace / 2 + root), np.abs(trace / 2 - root)).max()


def waves(config: "SphConfig", viscous: bool) -> tuple[NDArray, NDArray, NDArray]:
    """a, l and n of all waves of a case, in units of c0 / h; `viscous`: with the physical viscosity."""
    numerics, d = config.numerics, config.dimensions
    found = rates(numerics.kernel, d, numerics.smoothing)
    n = (numerics.artificial_viscosity or 0.0) * found["artificial"]
    if viscous and numerics.viscosity_form in PHYSICAL:
        n = n + kinematic_viscosity(config) / (config.sound_speed * config.h) * found[numerics.viscosity_form]
    return found["acoustic"], (numerics.flux_coefficient or 0.0) * found[numerics.density_flux], n


def kinematic_viscosity(config: "SphConfig") -> float:
    """nu of the fluid, m2/s."""
    return max((fluid.dynamic_viscosity / fluid.density for fluid in config.fluid), default=0.0)


def limit_of(integrator: str, a: NDArray, l: NDArray, n: NDArray) -> float:
    """The largest Courant number below which no wave grows by more than GROWTH per step."""

    def stable(z: float) -> Any:
        return amplification(integrator, a, l, n, z) <= 1 + GROWTH

    low = 0.0
    for high in TOP * np.geomspace(1e-6, 1.0, 120):
        if not stable(high):
            break
        low = high
    else:
        return TOP
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return float(low)


@functools.lru_cache(maxsize=64)
def _limit(config: "SphConfig", viscous: bool) -> float:
    return limit_of(config.simulation.integrator, *waves(config, viscous))


def courant_limit(config: "SphConfig") -> float:
    """Of dt c0 / h without the physical viscosity, which has a limit of its own."""
    return _limit(config, False)


def grows(config: "SphConfig", z: float) -> float:
    """Growth of the worst wave per step of Courant number z, all terms included; 0 when none grows."""
    return max(0.0, float(amplification(config.simulation.integrator, *waves(config, True), z)) - 1.0)


def viscous_limit(config: "SphConfig") -> float:
    """Of nu dt / h^2: the customary one, or less where the integrator would not stand the fastest decay."""
    numerics = config.numerics
    if numerics.viscosity_form not in PHYSICAL:
        return VISCOUS
    fastest = rates(numerics.kernel, config.dimensions, numerics.smoothing)[numerics.viscosity_form].max()
    return min(VISCOUS, 0.9 * DECAY[config.simulation.integrator] / float(fastest))


def step_parts(config: "SphConfig") -> dict[str, float]:
    """The criteria of the step in s at t = 0: acoustic, viscous, force; the least of them is taken."""
    h, nu = config.h, kinematic_viscosity(config)
    parts = {"acoustic": (config.simulation.cfl or 0.0) * h / config.sound_speed}
    if nu and config.numerics.viscosity_form in PHYSICAL:
        parts["viscous"] = viscous_limit(config) * h * h / nu
    acceleration = float(np.hypot(np.hypot(*config.gravity[:2]), sum(config.gravity[2:])))
    acceleration += float(np.sqrt(sum(b * b for b in config.body_force)))
    if acceleration:
        parts["force"] = FORCE * float(np.sqrt(h / acceleration))
    return parts


def time_step(config: "SphConfig") -> float:
    """The step at t = 0, s."""
    return config.simulation.time_step or min(step_parts(config).values())
