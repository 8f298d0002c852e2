"""Moving grains in a flow and near walls, against theory and computation. Each test prints what it measured."""

import math

import numpy as np
import pytest
from app_runner import running

import lbmdem
from hpcpic.core.space.domain import Domain, even_cuts
from lbmdem.app import shipped_cases
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.lubrication import Film
from lbmdem.physics.velocity_sets import D3Q19

pytestmark = pytest.mark.validation


def brenner(gap: float) -> float:
    """Force over 6 pi mu R U on a sphere that goes towards a plane wall; gap over R (Brenner 1961, equation 2.19)."""
    a = math.acosh(1.0 + gap)
    n = np.arange(1, int(40.0 / a))
    over = 2.0 * np.sinh((2 * n + 1) * a) + (2 * n + 1) * math.sinh(2.0 * a)
    under = 4.0 * np.sinh((n + 0.5) * a) ** 2 - (2 * n + 1) ** 2 * math.sinh(a) ** 2
    shares = n * (n + 1) / ((2 * n - 1) * (2 * n + 3)) * (over / under - 1.0)
    return 4.0 / 3.0 * math.sinh(a) * float(shares.sum())


def resolved(world, pool, radius, gap, offset):
    """The steady force of the links over 6 pi mu R U, sphere and gap in nodes."""
    n, tau, speed = round(7 * radius), 1.5, 1e-5
    domain = Domain((float(n),) * 3, (n, n, n), (False, True, True), even_cuts(n, 1))
    fluid = Fluid(world, pool, domain, D3Q19, tau=tau)
    immersed, viscosity = Immersed(fluid, world, pool), (tau - 0.5) / 3.0
    centre = np.array([[n / 2 + offset[0], n / 2 + offset[1], radius + gap - 0.5]])
    immersed.start(np.zeros(1, np.int64), centre, np.array([radius]), np.array([[0.0, 0.0, -speed]]), np.zeros((1, 3)))
    force, before = 0.0, 1.0
    while abs(force - before) > 2e-4 * abs(before):
        before = force
        for _ in range(50):
            fluid.step()
        force = immersed.all_forces(1)[0][0, 2] / (6.0 * math.pi * viscosity * radius * speed)
    return force


@pytest.mark.timeout(900)
def test_links_and_film_together_are_the_force_near_a_wall(world, pool):
    """Brenner's series, with 10 nodes across, on the mean of two places: 3 %, as the places differ by 5 % of what the
    links give; 7 % at two thirds of a node, where the links alone give that much too little."""
    assert brenner(0.01) == pytest.approx(100.0 + 0.2 * math.log(100.0) + 0.9713, rel=1e-4)
    radius, film = 5.0, Film.of_lattice(1.0, 1.0, 3)
    for share, within in ((0.01, 0.03), (0.02, 0.03), (0.05, 0.03), (0.1, 0.03), (0.4 / 3.0, 0.07), (0.3, 0.03)):
        links = np.mean([resolved(world, pool, radius, share * radius, at) for at in ((0.0, 0.0), (0.3, 0.4))])
        whole = links + film.resistance(share * radius, radius) / (6.0 * math.pi * radius)
        print(f"gap {share:.3f} R: links {links:.3f}, with film {whole:.3f}, Brenner {brenner(share):.3f}")
        assert abs(whole / brenner(share) - 1.0) < within


def force_on_a_disc(radius, gap, height, aside):
    """The steady force of the links over mu U on a disc whose surface goes towards a plane, lengths in nodes."""
    n, height = round(16 * radius), 1.0 + height
    case = lbmdem.Case(
        simulation={"dimensions": 2, "end_time": 1e9},
        domain={"size": [float(n), float(n)], "spacing": 1.0, "periodic": ["x"]},
        fluid={"density": 1.0, "kinematic_viscosity": 1.0, "relaxation_time": 1.5},
        obstacle=[{"shape": {"plane": {"point": [0.0, height], "normal": [0.0, 1.0]}}}],
        grains=[
            {
                "name": "disc",
                "diameter": 2 * radius,
                "moving": False,
                "position": [n / 2 + aside, height + gap + radius],
                "velocity": [0.0, -1e-5],
            }
        ],
        coupling={"refill": "mass-conserving"},  # links take and give some as the surface moves and the disc does not
    )
    force, before = 0.0, 1.0
    with case.simulation(threads=1) as sim:
        while abs(force - before) > 1e-3 * abs(force):
            sim.advance(steps=150)
            force, before = sim.scalars()["force_disc_y"] / 1e-5, force
    return force


@pytest.mark.timeout(900)
def test_links_and_film_of_a_disc_are_the_force_near_a_wall():
    """Jeffrey & Onishi 1981, with 10 nodes across: 5 % in the mean of places, which differ by up to 27 %. Before links
    of discs were measured it was 6, 19, 38 and 13 % too little."""
    radius, film = 5.0, Film.of_lattice(1.0, 1.0, 2)
    for gap in (0.1, 0.3, 0.6, 0.8):
        d, root = radius + gap, math.sqrt((2 * radius + gap) * gap)
        known = 4.0 * math.pi / (math.log((d + root) / radius) - root / d)
        places = [force_on_a_disc(radius, gap, at, aside) for at in (0.0, 0.25, 0.5, 0.75) for aside in (0.0, 0.3)]
        whole = float(np.mean(places)) + film.resistance(gap, radius)
        print(f"gap {gap} node: links {np.mean(places):.0f}, with film {whole:.0f}, theory {known:.0f}")
        assert abs(whole / known - 1.0) < 0.05


@pytest.mark.timeout(900)
@pytest.mark.parametrize(("gap", "substeps"), [(0.0125, 60), (-3e-4, 0)])
def test_a_sphere_goes_along_a_wall_and_rolls_as_lubrication_theory_has_it(gap, substeps):
    """Goldman, Cox & Brenner 1967, gap over R, free to turn without touch, without slip in touch with a gap of 1e-3 R.
    The box, 7 diameters wide, takes 4 to 8 %; before films at planes told sliding from turning, and while they touch,
    the force was 9 and 45 % too small, and a spin of 0.117 U / R was 0.39."""
    d, g, n = 1e-3, 0.02, 56
    case = lbmdem.Case(
        simulation={"dimensions": 3, "end_time": 2.0},
        domain={"size": [n * d / 8] * 3, "spacing": d / 8, "periodic": ["y", "z"]},
        fluid={"density": 1000.0, "kinematic_viscosity": 1e-5, "relaxation_time": 1.5},
        grains=[{"diameter": d, "density": 1200.0, "position": [0.5 * d * (1.0 + gap), n * d / 16, n * d / 16]}],
        contact={"normal_stiffness": 0.1, "damping": 0.5, "friction": 0.5, "tangential": "history"},
        coupling={"substeps": substeps},
        gravity=[-2.0 * g if gap < 0.0 else 0.0, 0.0, -g],
    )
    speed, before = 1.0, 0.0
    with case.simulation(threads=1) as sim:
        while abs(speed - before) > 2e-3 * speed:
            sim.advance(steps=100)
            sphere, before = sim.particles(sim.species[0]), speed
            speed = -float(sphere["velocity"][0, 2])
        spin = float(sphere["angular_velocity"][0, 1]) * 0.5 * d / speed
    force = math.pi / 6 * d**3 * 200.0 * g / (6 * math.pi * 1e-2 * 0.5 * d * speed)
    logarithm = math.log(1.0 / max(gap, 1e-3))
    sliding, turning = 8 / 15 * logarithm + 0.9588, 8 / 15 * logarithm + 4 / 3 * 0.3817  # of force, and torque over R
    both = 2 / 15 * logarithm - 0.2526
    rolls = 1.0 if gap < 0.0 else both / turning
    known = sliding - 2.0 * both * rolls + turning * rolls**2
    print(f"gap {gap} R: force {force:.2f}, theory {known:.2f}; spin {spin:.3f}, theory {rolls:.3f}")
    assert 1.0 < force / known < 1.1
    assert abs(spin - rolls) < 0.05


@pytest.mark.timeout(900)
def test_a_sphere_that_turns_beside_another_has_the_torques_of_jeffrey_and_onishi(world, pool):
    """Torques of links and film on both over 8 pi mu R^3 omega, near-touching forms with their constants, 10 nodes
    across: 5 % of what is known of the first. Films that knew sliding alone gave 1.42 and 0.27."""
    radius, gap, n, tau = 5.0, 0.1, 45, 1.2
    torques = np.zeros(2)
    for off in (0.0, 0.3):
        fluid = Fluid(world, pool, Domain((float(n),) * 3, (n,) * 3, (True,) * 3, even_cuts(n, 1)), D3Q19, tau=tau)
        immersed, spin = Immersed(fluid, world, pool), np.array([[0.0, 0.0, 2e-6], [0.0, 0.0, 0.0]])
        centres = n / 2 + off + np.outer([-1.0, 1.0], [radius + 0.5 * gap, 0.0, 0.0])
        immersed.start(np.arange(2), centres, np.full(2, radius), np.zeros((2, 3)), spin)
        for _ in range(600):
            fluid.step()
        torques -= immersed.all_forces(2)[1][:, 2] / (8.0 * math.pi * (tau - 0.5) / 3.0 * radius**3 * 2e-6) / 2
    film = Film.of_lattice(1.0, 1.0, 3).shear_resistance(gap, 0.5 * radius) / (8.0 * math.pi * radius)
    torques += film * np.array([1.6, 0.4])
    logarithm = math.log(radius / gap)
    known = 0.2 * logarithm + 0.7029, 0.05 * logarithm - 0.0274
    print(f"torque {torques[0]:.3f}, on the other {torques[1]:.3f}; theory {known[0]:.3f}, {known[1]:.3f}")
    assert np.abs(torques - known).max() < 0.05 * known[0]


@pytest.mark.timeout(900)
@pytest.mark.parametrize("nodes", [8, 16])
def test_a_disc_rolls_down_a_floor_as_its_film_has_it(nodes):
    """4 pi mu (2 R / h)^(1/2) per speed with the gap h = 1e-3 R of its roughness, and 2 % for all other drag; without
    shear of its film it rolled 11.3 and 7.5 times as fast, for 8 and 16 nodes across it."""
    d, pull, tilt = 1e-3, 0.5, 0.2
    case = lbmdem.Case(
        simulation={"dimensions": 2, "end_time": 5.0},
        domain={"size": [8 * d, 6 * d], "spacing": d / nodes, "periodic": ["x"]},
        fluid={"density": 1000.0, "kinematic_viscosity": 1e-5, "relaxation_time": 1.0},
        grains=[{"diameter": d, "density": 1500.0, "position": [4 * d, 0.4999 * d]}],
        contact={"normal_stiffness": 50.0, "damping": 0.3, "friction": 0.5, "tangential": "history"},
        gravity=[pull * tilt, -pull],
    )
    speed, before = 1.0, 0.0
    with case.simulation(threads=1) as sim:
        while abs(speed - before) > 1e-3 * abs(speed):
            sim.advance(steps=200 * (nodes // 8) ** 2)
            before, speed = speed, float(sim.particles(sim.species[0])["velocity"][0, 0])
    known = math.pi / 4 * d**2 * 500.0 * pull * tilt / (4 * math.pi * 1e-2 * math.sqrt(2e3))
    print(f"{nodes} nodes: speed {speed:.3g}, of its film {known:.3g}")
    assert 0.98 < speed / known < 1.0


@pytest.mark.timeout(900)
def test_a_neutral_disc_migrates_to_where_inertia_holds_it(world):
    """Segre & Silberberg; y / H = 0.2745 of Inamuro et al. 2000, D / H = 1/4, Re = 12.78: within 0.004, a sixth of a
    node."""
    with running(world, "lbmdem", shipped_cases()["segre-silberberg"].read_text()) as app:
        while app.iteration < app.n_steps:
            app.step()
        place, values = float(app.dem.grains.x[0, 1]) / 4.0e-3, app.scalars()
        disc = math.pi / 4 * 1.0e-6 * float(app.dem.grains.v[0, 0])
        reynolds = (values["momentum_x"] / 1000.0 + disc) / 4.0e-3 / 1.0e-6
    print(f"y / H {place:.4f}, reference 0.2745; Re {reynolds:.2f}, reference 12.78")
    assert abs(place - 0.2745) < 0.004
    assert abs(reynolds / 12.78 - 1.0) < 0.03
