"""Resistance of thin films."""

import math

import numpy as np
import pytest
from app_runner import running
from dem_scenes import box, grains
from scipy.integrate import quad

from hpcpic.core.physics.contact_law import ContactLaw
from lbmdem.forecast.derived import derived
from lbmdem.grains.dem import Dem
from lbmdem.physics.lubrication import ROUGHNESS, STABLE, Film
from lbmdem.physics.plane_walls import PlaneWall


def squeezed(gap, radius, dimensions):
    """Force over velocity of the parabolic film: pressure 6 mu U R / h^2 or 3 mu U R / h^2 (Reynolds), mu = 1."""

    def height(s):
        return gap + s * s / (2 * radius)

    if dimensions == 2:
        return quad(lambda s: 6 * radius / height(s) ** 2, -np.inf, np.inf, epsabs=0, limit=500)[0]
    return quad(lambda s: 3 * radius / height(s) ** 2 * 2 * np.pi * s, 0, np.inf, epsabs=0, limit=500)[0]


@pytest.mark.parametrize("dimensions", [2, 3])
def test_resistance_is_the_film_less_that_at_the_cut_off(dimensions):
    """Links give less of it in a narrow gap: of spheres from 0.53 on, of discs from nothing."""
    film = Film(2.0, 0.05, dimensions)
    for gap in (0.001, 0.01, 0.04, 0.045):
        given = min(0.53 + 0.55 * gap / 0.05, 1.0) if dimensions == 3 else gap / 0.05
        wanted = 2.0 * (squeezed(gap, 0.7, dimensions) - given * squeezed(0.05, 0.7, dimensions))
        assert film.resistance(gap, 0.7) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_films_begin_at_the_cut_off_and_end_at_contact(dimensions):
    film = Film.of_lattice(1.0, 0.1, dimensions)
    gaps = np.linspace(0.0, film.cut_off, 200)
    values = np.array([film.resistance(gap, 0.5) for gap in gaps])
    assert np.all(np.diff(values) <= 0.0) and values[-1] == 0.0
    assert values[0] == film.resistance(ROUGHNESS * 0.5, 0.5) > 0.0
    assert film.resistance(-1e-9, 0.5) == 0.0
    assert film.resistance(0.999 * film.cut_off, 0.5) < 0.01 * values[0]


@pytest.mark.parametrize("dimensions", [2, 3])
def test_units_by_powers_of_two_give_the_same_bits(dimensions):
    one, other = Film(0.3, 0.05, dimensions), Film(0.3 * 2.0**10, 0.05 * 2.0**-20, dimensions)
    scale = 2.0**10 * (2.0**-20 if dimensions == 3 else 1.0)
    assert other.resistance(0.01 * 2.0**-20, 0.7 * 2.0**-20) == one.resistance(0.01, 0.7) * scale


VISCOSITY, CUT, SPEED = 0.5, 0.006, 1e-3
RADII = [(0.05, 0.05), (0.05, 0.02), (0.03, 0.12)]


def at_contact(world, pool, radii, gap, v, omega, floor=None):
    """Forces [n, 8] of the films between grains that keep these velocities, one behind the other along x."""
    d = len(v[0])
    x = np.full((len(radii), d), 0.4)
    x[:, 0] = 0.2 if floor is None else gap + radii[0]
    x[1:, 0] += np.sum(radii) + gap
    columns = grains(x, v=np.array(v), omega=np.array(omega), radius=np.array(radii))
    columns["mass"][:], columns["inertia"][:] = 1e9, 1e9
    film = Film(VISCOSITY, CUT, d)
    walls = () if floor is None else (floor,)
    scene = Dem(world, pool, box(world, (1.0,) * d), columns, ContactLaw(1e-3), walls, film=film)
    scene.advance(1e-3, 1)
    return scene.grains.columns["force"][np.argsort(scene.grains.ids[: len(radii)])]


@pytest.mark.parametrize(("a", "b"), RADII)
@pytest.mark.parametrize("gap", [1e-4, -1e-9])
def test_films_of_spheres_of_any_radii_have_the_logarithms_of_jeffrey_and_onishi(world, pool, a, b, gap):
    """Y^A, Y^B and Y^C of J. Fluid Mech. 139 (1984) 261, for a sphere that slides and one that turns beside another,
    without friction; while they touch the gap is that of the roughness."""
    ratio, r = b / a, a * b / (a + b)
    log = np.log(0.85 * CUT / max(gap, ROUGHNESS * r))
    known = {
        "a": 4 / 15 * ratio * (2 + ratio + 2 * ratio**2) / (1 + ratio) ** 3 * 6 * np.pi * a,
        "b": 1 / 5 * ratio * (4 + ratio) / (1 + ratio) ** 2 * 4 * np.pi * a**2,
        "c11": 2 / 5 * ratio / (1 + ratio) * 8 * np.pi * a**3,
        "c12": 4 / 5 * ratio**2 / (1 + ratio) ** 4 * np.pi * (a + b) ** 3,
    }
    known = {name: value * VISCOSITY * log * SPEED for name, value in known.items()}
    still = [0.0, 0.0, 0.0]
    slides = at_contact(world, pool, (a, b), gap, [[0.0, SPEED, 0.0], still], [still, still])
    turns = at_contact(world, pool, (a, b), gap, [still, still], [[0.0, 0.0, SPEED], still])
    assert slides[0, [1, 6]] == pytest.approx([-known["a"], -known["b"]], rel=1e-4)
    assert turns[0, [1, 6]] == pytest.approx([-known["b"], -known["c11"]], rel=1e-4)
    assert turns[1, [1, 6]] == pytest.approx([known["b"], -known["c12"]], rel=1e-4)
    assert slides[:, 3] == pytest.approx(known["a"] * SPEED, rel=1e-4)  # each grain's half of the heat, twice
    assert turns[:, 3] == pytest.approx(known["c11"] * SPEED, rel=1e-4)


@pytest.mark.parametrize(("gap", "screen"), [(1e-3, False), (-1e-9, False), (-1e-9, True)])
def test_a_film_at_a_plane_tells_sliding_from_turning(world, pool, gap, screen):
    """Goldman, Cox & Brenner 1967, leading terms: 8/15, 2/15 and 8/15 of 6 pi mu R ln(1/gap) between the velocity of a
    sphere, that of its surface by turning, force and torque over R; the plane slides too, and nothing makes energy.
    While they touch the gap is that of the roughness, without friction here; a screen has no film."""
    radius, viscosity = 0.05, 0.5
    film = Film(viscosity, 0.006, 3)
    unit = 6 * np.pi * viscosity * radius * np.log(0.85 * 0.006 / max(gap, ROUGHNESS * radius)) / 15 * (not screen)

    def found(v, omega, slide):
        columns = grains([[0.5, 0.5, radius + gap]], v=np.array([v]), omega=np.array([omega]), radius=radius)
        columns["mass"][:], columns["inertia"][:] = 1e9, 1e9  # it keeps its velocities
        floor = PlaneWall([0.0] * 3, np.eye(3)[2], (slide, 0.0, 0.0), film=not screen)
        scene = Dem(world, pool, box(world, (1.0,) * 3), columns, ContactLaw(1e-3), (floor,), film=film)
        scene.advance(1e-3, 1)
        line = scene.grains.columns["force"][0]
        return line[0], line[5] / radius, 0.5 * line[3]  # half of a contact's heat is one grain's

    for slide, spin in ((1e-3, 0.0), (0.0, 1e-3), (1e-3, -1e-3), (1e-3, 1e-3)):
        force, torque, heat = found((slide, 0.0, 0.0), (0.0, -spin / radius, 0.0), 0.0)  # its surface goes as spin
        assert force == pytest.approx(-unit * (8 * slide + 2 * spin), rel=1e-4)
        assert torque == pytest.approx(unit * (2 * slide + 8 * spin), rel=1e-4)
        assert heat == pytest.approx(unit * (8 * slide**2 + 4 * slide * spin + 8 * spin**2), rel=1e-4)
        moved = found((slide + 2e-3, 0.0, 0.0), (0.0, -spin / radius, 0.0), 2e-3)
        assert moved == pytest.approx((force, torque, heat), rel=1e-4)


def reynolds(gap, r, s, p):
    """Heat of a film between discs whose surfaces slide with s and go with p / 2 in the mean, mu = 1: shear, and the
    pressure that lets the same flow through everywhere and is the same on both sides."""

    def over(power):
        return quad(lambda x: (gap + x * x / (2 * r)) ** -power, -np.inf, np.inf, epsabs=0, limit=500)[0]

    flow = 0.5 * p * over(2) / over(3)
    return s * s * over(1) + 12 * (flow**2 * over(3) - flow * p * over(2) + 0.25 * p * p * over(1))


@pytest.mark.parametrize(("a", "b"), [*RADII, (0.05, np.inf)])
def test_films_of_discs_make_the_heat_of_reynolds_equation(world, pool, a, b):
    """At a plane too; forces and torques give the grains' work to it."""
    gap, plane = 1e-4, not np.isfinite(b)
    r, d = (a, 1.0) if plane else (a * b / (a + b), (b - a) / (a + b))
    floor = PlaneWall([0.0, 0.0], [1.0, 0.0]) if plane else None
    for v, w in ((SPEED, 0.0), (0.0, SPEED / a), (SPEED, -2.0 * SPEED / a)):
        still = [] if plane else [[0.0, 0.0]]
        radii = (a,) if plane else (a, b)
        lines = at_contact(world, pool, radii, gap, [[0.0, v], *still], [[w]] + [[0.0]] * len(still), floor)
        side = -1.0 if plane else 1.0  # on which the other is
        s, p = -(v + side * a * w), side * a * w - d * v
        heat = VISCOSITY * (reynolds(gap, r, s, p) - reynolds(0.66 * CUT, r, s, p))
        assert np.mean(lines[:, 3]) * (0.5 if plane else 1.0) == pytest.approx(heat, rel=1e-4)
        assert -(lines[0, 1] * v + lines[0, 6] * w) == pytest.approx(heat, rel=1e-4)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_gap_of_a_resistance_is_its_inverse(dimensions):
    film = Film(2.0, 0.05, dimensions)
    for gap in (0.001, 0.01, 0.04, 0.0499):
        assert film.gap_of(film.resistance(gap, 0.7), 0.7) == pytest.approx(gap)
    assert film.gap_of(0.0, 0.7) == pytest.approx(film.cut_off)


FILM_CASE = """
simulation = { end_time = 1.0; };
domain = { size = [4.0e-3, 4.0e-3, 4.0e-3]; spacing = 2.0e-4; };
fluid = { density = 970.0; viscosity = 1.0e-4; relaxation_time = 1.1; };
grains = ({ diameter = 2.0e-3; density = 2650.0; position = [2.05e-3, 2.0e-3, 1.02e-3]; });
gravity = [0.0, 0.0, -9.81];
contact = { normal_stiffness = 100.0; damping = 0.3; };
"""


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("share", [0.01, 0.02, 0.05])
def test_a_film_has_its_whole_force_with_the_substeps_that_it_asks_for(world, pool, d, share):
    """A grain pressed on a wall, with contacts that would be stable with one substep in a step of the fluid. Six
    digits: what it changes its speed by in a substep is less."""
    radius, fluid_step = 0.05, 0.2
    film = Film(0.5, radius * 2 / 15, d)  # ten nodes across it
    columns = grains([[0.5] * (d - 1) + [radius * (1 + share)]])
    floor = PlaneWall([0.0] * d, np.eye(d)[-1])
    scene = Dem(world, pool, box(world, (1.0,) * d), columns, ContactLaw(1e-3), (floor,), film=film)
    push = np.zeros((1, d))
    push[0, -1] = -1e-5 * film.resistance(share * radius, radius)
    for _ in range(20):
        n = math.ceil(fluid_step * scene.fastest_film(fluid_step) / STABLE)
        scene.advance(fluid_step / n, n, push)
    gap, v = scene.grains.x[0, -1] - radius, scene.grains.v[0, -1]
    assert n > 3 and gap < share * radius
    force = scene.grains.columns["force"][0, d - 1]
    assert force == pytest.approx(-film.resistance(gap, radius) * v, rel=1e-6)
    assert force == pytest.approx(-push[0, -1], rel=1e-2)


def test_films_keep_momentum_and_never_make_energy(world, pool):
    """A line of spheres of two sizes that fly together, with gaps down to a thousandth: no clip at the substeps that
    `fastest_film` asks for, momentum to rounding, and less kinetic energy after every one."""
    radius = np.array([0.05, 0.03, 0.05, 0.05])
    gaps = np.array([1e-4, 1e-3, 5e-5])
    x = np.full((4, 3), 0.5)
    x[:, 0] = 0.2 + np.cumsum([0.0, *(radius[:-1] + radius[1:] + gaps)])
    v = 0.01 * np.array([[0.1, 0.02, 0.0], [0.0, 0.0, 0.0], [-0.3, 0.0, 0.1], [0.05, -0.1, 0.0]])
    columns = grains(x, v=v, radius=radius)
    film = Film(0.5, 0.01, 3)
    scene = Dem(world, pool, box(world, (1.0,) * 3), columns, ContactLaw(1.0), film=film)
    order = np.argsort(scene.grains.ids[:4])

    def now():
        own = scene.grains
        u, w = own.v[:4][order], own.omega[:4][order]
        energy = 0.5 * np.sum(columns["mass"] * np.sum(u * u, axis=1) + columns["inertia"] * np.sum(w * w, axis=1))
        return columns["mass"] @ u, energy

    (start, energy), fluid_step = now(), 2e-2
    for _ in range(5):
        wanted = fluid_step * scene.fastest_film(fluid_step) / STABLE
        n = math.ceil(wanted)
        assert n > 10
        for _ in range(n):
            scene.advance(fluid_step / n, 1)
            momentum, left = now()
            assert np.abs(momentum - start).max() < 1e-14 * np.abs(columns["mass"][:, None] * v).sum()
            assert left <= energy * (1 + 1e-12)
            energy = left


def least_film(world, sets):
    with running(world, "lbmdem", FILM_CASE, sets) as app:
        app.step()
        told = {number.name: number for number in derived(app.scene.config)}
        return app.scalars()["least_film"], app.grains.substeps, told["gap of limited films"]


def test_what_is_limited_is_told(world):
    """Where the number of substeps is given, films get what is stable with it; `check` and the series say so."""
    soft = "contact.normal_stiffness=0.01"
    share, n, told = least_film(world, [soft])
    assert (share, n, told.verdict, told.value) == (1.0, 1, "ok", 0.0)
    share, n, told = least_film(world, [soft, "coupling.substeps=1"])
    assert share < 0.5 and n == 1 and told.verdict == "warn" and 0.02 < told.value < 0.2
    share, n, told = least_film(world, [soft, f"coupling.substeps={told.cure.split()[2]}"])
    assert share == 1.0 and told.verdict == "ok"
