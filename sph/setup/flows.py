"""Velocities and pressures with which fluids start; points x[n, d] in m."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.start import Start, arrays
from hpcpic.core.space.elementary import cos, cosh, sin, sinh
from hpcpic.core.space.products import product
from sph.case import geometry
from sph.case.config import AXES, Flow, Fluid, SphConfig
from sph.case.shapes import Shape
from sph.physics.equation_of_state import EquationOfState
from sph.physics.liquids import Liquids
from sph.setup.particle_lattices import along, even
from sph.setup.signed_distance import signed_distance
from sph.setup.tanks import holds

TERMS = 60  # of the double sine series in each direction
FALLS, CLOSE = 60, 1e-4  # most ways in turn down to a shape; part of a step that is no way
GAP = 3.0  # spacings between particles over each other, beyond which they are drops over a fluid, or a body is between


class Liquid(Protocol):
    """What is read of a scene: its case and liquids, spacing m, gravity[d] m/s2 and the equation of state."""

    config: SphConfig
    liquids: Liquids
    spacing: float
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
    return surface(scene, fluid, x) - product(x, up(scene))


def surface(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """Heights[n] against gravity of the free surface of a fluid over points, m: that which the case gives, else the top
    of its shape. Of all but boxes along gravity, and what is round or of STL among several liquids, it is their own
    upper side over a point, as far as no wall lies on that; under walls it goes on from one such place to the next.
    """
    if fluid.surface is not None:
        return np.full(len(x), fluid.surface)
    z, corners, box = up(scene), geometry.outline(fluid.shape), fluid.shape.box
    if fluid.start and "position" in arrays(fluid.start):
        return nearest_top(scene, fluid, *columns_of(fluid.start, tuple(z.tolist()), scene.spacing), x)
    if np.count_nonzero(z) > 1 if box else not (corners or scene.liquids.densities):
        return nearest_top(scene, fluid, *columns_in(fluid.shape, tuple(z.tolist()), scene.spacing / 2), x)
    if not corners:
        return np.full(len(x), heights(scene, fluid)[1])
    axis = along(z)[0]
    ends = np.stack([product(np.array(corners), axis), product(np.array(corners), z)], axis=1)
    first, last = ends[:, 0].min(), ends[:, 0].max()
    columns = even(first, last, scene.spacing / 2)
    tops = upper_side(ends, columns)
    open_ = uncovered(scene, columns[:, None], tops)
    if not open_.any():
        return np.full(len(x), heights(scene, fluid)[1])
    at = np.clip(product(x, axis), first, last)
    own = open_[np.clip(((at - first) / (last - first) * len(columns)).astype(np.int64), 0, len(columns) - 1)]
    return np.where(own, upper_side(ends, at), np.interp(at, columns[open_], tops[open_]))


def nearest_top(scene: Liquid, fluid: Fluid, columns: NDArray, tops: NDArray, x: NDArray) -> NDArray[np.float64]:
    """Heights[n] over points, m, of the top of the nearest column[m, d - 1] across gravity of a fluid, or, where a wall
    lies on that, of the nearest on which none does.
    """
    from scipy.spatial import cKDTree

    open_ = uncovered(scene, columns, tops)
    if not open_.any():
        return np.full(len(x), heights(scene, fluid)[1])
    at = product(x, along(up(scene)).T)
    own, free = cKDTree(columns).query(at)[1], cKDTree(columns[open_]).query(at)[1]
    return np.where(open_[own], tops[own], tops[open_][free])


@lru_cache(maxsize=8)
def columns_in(shape: Shape, z: geometry.Point, step: float) -> tuple[NDArray, NDArray]:
    """Places[m, d - 1] across z of columns of a shape, a step apart, and heights[m] of their tops, m: down from over it
    by the distance to it, again and again.
    """
    low, high = map(np.array, geometry.bounds(shape))
    middle, upwards, reach = (low + high) / 2, np.array(z), float(np.linalg.norm(high - low)) / 2
    axes, line = along(upwards), even(-reach, reach, step)
    at = np.stack(np.meshgrid(*[line] * len(axes), indexing="ij"), axis=-1).reshape(-1, len(axes))
    x, way, going = middle + product(at, axes), np.full(len(at), reach), np.arange(len(at))
    for _ in range(FALLS):
        off = signed_distance(shape, x[going] + way[going, None] * upwards)
        way[going] -= off
        going = going[(off > CLOSE * step) & (way[going] > -reach)]
    way[going] = -math.inf
    found = way > -reach
    return at[found] + product(axes, middle), product(middle, upwards) + way[found]


@lru_cache(maxsize=8)
def columns_of(start: Start, z: tuple[float, ...], dp: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places[m, d - 1] across gravity of columns of given particles, a spacing wide, and heights[m] of their tops, m:
    half a spacing over the highest particle under the first gap.
    """
    x, upwards = np.asarray(arrays(start)["position"], float), np.array(z)
    at, height = product(x, along(upwards).T), product(x, upwards)
    low = at.min(axis=0)
    cells, column = np.unique(np.rint((at - low) / dp).astype(np.int64), axis=0, return_inverse=True)
    order = np.lexsort((height, column.ravel()))
    column, height = column.ravel()[order], height[order]
    first = np.diff(column, prepend=-1) > 0
    gaps = np.cumsum(~first & (np.diff(height, prepend=height[0]) > GAP * dp))
    lowest = gaps == gaps[first][column]
    tops = np.full(len(cells), -np.inf)
    np.maximum.at(tops, column[lowest], height[lowest])
    return low + cells * dp, tops + dp / 2


def uncovered(scene: Liquid, columns: NDArray, tops: NDArray) -> NDArray[np.bool_]:
    """On which columns[m, d - 1] across gravity of a fluid, with heights[m] of their tops in m, no wall lies."""
    z = up(scene)
    k = int(np.argmax(np.abs(z)))
    side = AXES[k] + "-+"[int(z[k] > 0.0)]
    beyond = product(columns, along(z)) + (tops + scene.spacing / 2)[:, None] * z
    return np.all([np.ones(len(columns), bool), *(~holds(wall, beyond, side) for wall in scene.config.wall)], axis=0)


def upper_side(corners: NDArray, at: NDArray) -> NDArray[np.float64]:
    """Heights[n] of the highest points of a polygon with corners[., (along, up)] at places along it, m."""
    found = np.full(len(at), -np.inf)
    for (a, low), (b, high) in zip(corners, np.roll(corners, -1, axis=0)):
        if a != b:
            there = (min(a, b) <= at) & (at <= max(a, b))
            found[there] = np.maximum(found[there], low + (at[there] - a) / (b - a) * (high - low))
    return found


def hydrostatic(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """rho - rho0 of the reference liquid, kg/m3, at the pressure of rest[n]: under gravity that of what lies over a
    point, else the mean one of the outlets.
    """
    g = math.hypot(*scene.gravity)
    if not g and scene.config.outlet:
        mean = float(np.mean([outlet.pressure for outlet in scene.config.outlet]))
        return scene.eos.excess(np.full(len(x), mean))
    own = g * np.maximum(depth(scene, fluid, x), 0.0) / scene.liquids.lightness(fluid)
    return scene.eos.excess_at_head(load(scene, fluid, x) + own)


def load(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """The head[n] in the reference liquid, m2/s2, of the fluids at rest that lie over points of a fluid, and on each
    other, up to the first whose height of the surface the case gives; none where it gives its own.
    """
    found = np.zeros(len(x))
    if fluid.surface is not None or not scene.gravity.any():
        return found
    g, z = math.hypot(*scene.gravity), surface(scene, fluid, x)
    others = [other for other in scene.config.fluid if other is not fluid and at_rest(other)]
    for other in sorted(others, key=lambda one: heights(scene, one)[0]):
        bottom, top = heights(scene, other)
        top = top if other.surface is None else other.surface
        over = (bottom <= z + scene.spacing / 2) & (z < top) & below(scene, other, x)
        found[over] += g * (top - z[over]) / scene.liquids.lightness(other)
        z[over] = top if other.surface is None else math.inf
    return found


def heights(scene: Liquid, fluid: Fluid) -> tuple[float, float]:
    """Heights against gravity of the bottom and the top of a fluid, m."""
    found = [float(product(np.array(corner), up(scene))) for corner in geometry.corners(fluid.shape)]
    return min(found), max(found)


def below(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.bool_]:
    """Which points[n] have a fluid's box over or under them, if gravity goes along an axis."""
    low, high = geometry.bounds(fluid.shape)
    return np.all([(low[k] <= x[:, k]) & (x[:, k] <= high[k]) for k in np.flatnonzero(scene.gravity == 0.0)], axis=0)


def centre_of(fluid: Fluid, flow: Flow) -> geometry.Point:
    """Where a linear flow has no velocity, m; in the middle of its fluid where the case does not say. Other flows have
    no centre: a wave on the interface of two fluids is one flow.
    """
    middle = geometry.middle(fluid.shape)
    return flow.centre or (middle if FLOWS[flow.type] is Linear else (0.0,) * len(middle))


class Linear:
    """v = G (x - centre), and p with lap p = -rho tr(G^2) that is 0 on the surface of a disc, sphere or rectangle."""

    needs_gradient, needs_gravity = True, False

    @staticmethod
    def speed(fluid: Fluid, flow: Flow, g: float) -> float:
        centre = centre_of(fluid, flow)
        return max(math.hypot(*geometry.linear(flow.gradient, centre, c)) for c in geometry.corners(fluid.shape))

    @staticmethod
    def velocity(scene: Liquid, fluid: Fluid, flow: Flow, x: NDArray) -> NDArray[np.float64]:
        gradient = np.array(flow.gradient).reshape(scene.dimensions, -1)
        return product(x - np.array(flow.centre), gradient.T)

    @staticmethod
    def pressure(scene: Liquid, fluid: Fluid, flow: Flow, x: NDArray) -> NDArray[np.float64]:
        gradient = np.array(flow.gradient).reshape(scene.dimensions, -1)
        source = scene.eos.rho0 * float(np.sum(gradient * gradient.T))
        if fluid.shape.sphere:
            r2 = np.sum((x - np.array(fluid.shape.sphere.centre)) ** 2, axis=1)
            return source / (2 * scene.dimensions) * (fluid.shape.sphere.radius**2 - r2)
        low, high = map(np.array, geometry.bounds(fluid.shape))
        return source * rectangle(x - low, high - low)


class Vortices:
    """Vortices of Taylor and Green in the first two components: p = -rho U^2 / 4 (cos 2kx + cos 2ky)."""

    needs_gradient = needs_gravity = False

    @staticmethod
    def speed(fluid: Fluid, flow: Flow, g: float) -> float:
        return abs(flow.amplitude)

    @staticmethod
    def velocity(scene: Liquid, fluid: Fluid, flow: Flow, x: NDArray) -> NDArray[np.float64]:
        v, k, a = np.zeros_like(x), 2 * math.pi / flow.wavelength, flow.amplitude
        v[:, 0] = -a * cos(k * x[:, 0]) * sin(k * x[:, 1])
        v[:, 1] = a * sin(k * x[:, 0]) * cos(k * x[:, 1])
        return v

    @staticmethod
    def pressure(scene: Liquid, fluid: Fluid, flow: Flow, x: NDArray) -> NDArray[np.float64]:
        k, a = 2 * math.pi / flow.wavelength, flow.amplitude
        return -scene.eos.rho0 * a * a / 4 * (cos(2 * k * x[:, 0]) + cos(2 * k * x[:, 1]))


def wave_square(k: float, g: float, below: tuple[float, float], above: tuple[float, float]) -> float:
    """omega^2 in 1/s2 of a wave of number k on the interface of two liquids between walls, each of a density and depth;
    below 0 where the heavier one lies above: it grows by exp(abs(omega) t) (Rayleigh and Taylor).
    """
    (rho, depth), (light, height) = below, above
    heavy, other = rho / math.tanh(k * depth), light / math.tanh(k * height)
    return g * k * (rho - light) / (heavy + other)


class StandingWave:
    """The velocity of a standing wave of small amplitude, and the pressure of rest: the surface is flat at t = 0. Where
    another fluid of this flow lies on this one, or under it, the wave is that of their interface.
    """

    needs_gradient, needs_gravity = False, True

    @staticmethod
    def speed(fluid: Fluid, flow: Flow, g: float) -> float:
        return abs(flow.amplitude) * math.sqrt(g * (2 * math.pi / flow.wavelength))  # of deep water

    @staticmethod
    def velocity(scene: Liquid, fluid: Fluid, flow: Flow, x: NDArray) -> NDArray[np.float64]:
        v, k, a = np.zeros_like(x), 2 * math.pi / flow.wavelength, flow.amplitude
        vertical = int(np.argmax(np.abs(scene.gravity)))
        low, high = geometry.bounds(fluid.shape)
        water, g = high[vertical] - low[vertical], math.hypot(*scene.gravity)
        other = interface(scene.config, fluid, vertical)
        w, sign, far = math.sqrt(g * k * math.tanh(k * water)), 1.0, low[vertical]
        if other:
            square, at = interfacial(fluid, other, vertical, k, g)
            w = math.sqrt(abs(square))
            sign, far = (1.0, low[vertical]) if math.isclose(at, high[vertical]) else (-1.0, high[vertical])
        along, above = k * (x[:, 0] - low[0]), k * sign * (x[:, vertical] - far)
        v[:, 0] = -a * w * sign * cosh(above) / math.sinh(k * water) * sin(along)
        v[:, vertical] = a * w * sinh(above) / math.sinh(k * water) * cos(along)
        return v

    @staticmethod
    def pressure(scene: Liquid, fluid: Fluid, flow: Flow, x: NDArray) -> NDArray[np.float64]:
        return scene.eos.pressure(hydrostatic(scene, fluid, x))


def interface(config: SphConfig, fluid: Fluid, vertical: int) -> Fluid | None:
    """The fluid with the same flow that touches a fluid along an axis."""
    low, high = (corner[vertical] for corner in geometry.bounds(fluid.shape))
    for other in config.fluid:
        a, b = (corner[vertical] for corner in geometry.bounds(other.shape))
        if other.flow == fluid.flow and other is not fluid and (math.isclose(a, high) or math.isclose(b, low)):
            return other
    return None


def interfacial(fluid: Fluid, other: Fluid, vertical: int, k: float, g: float) -> tuple[float, float]:
    """omega^2 in 1/s2 of a wave of number k on the interface of two fluids, and its height in m."""
    below, above = sorted((fluid, other), key=lambda one: geometry.bounds(one.shape)[0][vertical])
    (bottom, at), (_, top) = ([corner[vertical] for corner in geometry.bounds(one.shape)] for one in (below, above))
    return wave_square(k, g, (below.density, at - bottom), (above.density, top - at)), at


FLOWS: dict[str, Any] = {"linear": Linear, "taylor-green": Vortices, "standing-wave": StandingWave}


def flow_of(fluid: Fluid, kind: Any) -> Flow | None:
    """The initial flow of a fluid, if it is of this kind."""
    return fluid.flow if fluid.flow and FLOWS[fluid.flow.type] is kind else None


def speed(config: SphConfig, fluid: Fluid) -> float:
    """Largest speed with which a fluid starts, m/s, besides its uniform velocity."""
    if fluid.start:
        return float(np.sqrt((np.asarray(arrays(fluid.start).get("velocity", 0.0)) ** 2).sum(axis=-1)).max(initial=0.0))
    return FLOWS[fluid.flow.type].speed(fluid, fluid.flow, math.hypot(*config.gravity)) if fluid.flow else 0.0


def velocity(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """v[n, d] at t = 0, m/s."""
    v = np.tile(np.array(fluid.velocity), (len(x), 1))
    return v + FLOWS[fluid.flow.type].velocity(scene, fluid, fluid.flow, x) if fluid.flow else v


def density_of_flow(scene: Liquid, fluid: Fluid, x: NDArray) -> NDArray[np.float64]:
    """rho - rho0[n] of the pressure that keeps the initial flow free of divergence, kg/m3."""
    assert fluid.flow is not None
    return scene.eos.excess(FLOWS[fluid.flow.type].pressure(scene, fluid, fluid.flow, x))


INITIAL_DENSITIES: dict[str, Callable[[Liquid, Fluid, NDArray], NDArray[np.float64]]] = {
    "zero": lambda scene, fluid, x: np.zeros(len(x)), "hydrostatic": hydrostatic, "flow": density_of_flow,
}  # fmt: skip


def at_rest(fluid: Fluid) -> bool:
    """Whether a fluid starts with the pressure of rest under gravity."""
    return INITIAL_DENSITIES[fluid.initial_pressure] is hydrostatic


def rectangle(x: NDArray, size: NDArray) -> NDArray[np.float64]:
    """Solution[n] of -lap p = 1 in a rectangle with p = 0 around it, by its sine series."""
    n = np.arange(1, 2 * TERMS, 2)
    kx, ky = n * math.pi / size[0], n * math.pi / size[1]
    weights = 16 / (math.pi**2 * np.outer(n, n)) / (kx[:, None] ** 2 + ky[None] ** 2)
    return np.einsum("pa,ab,pb->p", sin(x[:, :1] * kx), weights, sin(x[:, 1:2] * ky))
