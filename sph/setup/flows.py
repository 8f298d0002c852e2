"""Velocities and pressures with which fluids start; points x[n, d] in m."""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case import geometry
from sph.case.config import Fluid
from sph.physics.equation_of_state import EquationOfState

TERMS = 60  # of the double sine series in each direction


class Liquid(Protocol):
    """What is read of a scene: gravity[d] m/s2 and the equation of state."""

    dimensions: int
    gravity: NDArray[np.float64]
    eos: EquationOfState


def up(scene: Liquid) -> NDArray[np.float64]:
    """Unit vector against gravity."""
    return -scene.gravity / math.hypot(*scene.gravity)


def depth(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """Distance[n] below the free surface of a fluid along gravity; 0 without gravity."""
    if not scene.gravity.any():
        return np.zeros(len(x))
    top = fluid.surface
    if top is None:
        top = max(float(np.dot(corner, up(scene))) for corner in geometry.corners(fluid.shape))
    return top - product(x, up(scene))


def hydrostatic(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """rho - rho0 at rest[n], kg/m3."""
    return scene.eos.excess_at_rest(depth(scene, fluid, x), math.hypot(*scene.gravity))


def velocity(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """v[n, d] at t = 0, m/s."""
    v = np.tile(np.array(fluid.velocity), (len(x), 1))
    flow = fluid.flow
    if flow is None:
        return v
    if flow.type == "linear":
        gradient = np.array(flow.gradient).reshape(scene.dimensions, -1)
        return v + product(x - np.array(flow.centre), gradient.T)
    k, a = 2 * math.pi / flow.wavelength, flow.amplitude
    if flow.type == "taylor-green":
        v[:, 0] -= a * np.cos(k * x[:, 0]) * np.sin(k * x[:, 1])
        v[:, 1] += a * np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])
        return v
    vertical = int(np.argmax(np.abs(scene.gravity)))
    low, high = geometry.bounds(fluid.shape)
    water = high[vertical] - low[vertical]
    w = math.sqrt(math.hypot(*scene.gravity) * k * math.tanh(k * water))
    along, above = k * (x[:, 0] - low[0]), k * (x[:, vertical] - low[vertical])
    v[:, 0] -= a * w * np.cosh(above) / math.sinh(k * water) * np.sin(along)
    v[:, vertical] += a * w * np.sinh(above) / math.sinh(k * water) * np.cos(along)
    return v


def pressure(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """p[n] in Pa that keeps the initial flow free of divergence.

    Vortices: -rho U^2 / 4 (cos 2kx + cos 2ky). Linear: lap p = -rho tr(G^2) with p = 0 on the surface of a disc,
    sphere or rectangle.
    """
    flow = fluid.flow
    assert flow is not None
    if flow.type == "taylor-green":
        k, a = 2 * math.pi / flow.wavelength, flow.amplitude
        return -scene.eos.rho0 * a * a / 4 * (np.cos(2 * k * x[:, 0]) + np.cos(2 * k * x[:, 1]))
    if flow.type == "standing-wave":
        return scene.eos.pressure(hydrostatic(scene, fluid, x))
    gradient = np.array(flow.gradient).reshape(scene.dimensions, -1)
    source = scene.eos.rho0 * float(np.trace(gradient @ gradient))
    if fluid.shape.sphere:
        r2 = np.sum((x - np.array(fluid.shape.sphere.centre)) ** 2, axis=1)
        return source / (2 * scene.dimensions) * (fluid.shape.sphere.radius**2 - r2)
    low, high = map(np.array, geometry.bounds(fluid.shape))
    return source * rectangle(x - low, high - low)


def rectangle(x: NDArray, size: NDArray) -> NDArray[np.float64]:
    """Solution[n] of -lap p = 1 in a rectangle with p = 0 around it, by its sine series."""
    n = np.arange(1, 2 * TERMS, 2)
    kx, ky = n * math.pi / size[0], n * math.pi / size[1]
    weights = 16 / (math.pi**2 * np.outer(n, n)) / (kx[:, None] ** 2 + ky[None] ** 2)
    return np.einsum("pa,ab,pb->p", np.sin(x[:, :1] * kx), weights, np.sin(x[:, 1:2] * ky))
