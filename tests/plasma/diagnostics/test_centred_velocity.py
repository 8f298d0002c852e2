"""Particles that drift by E x B / B^2 and fall along B: the series tells their motion, however far a step turns."""

import numpy as np
import pytest
from plasma_cases import advanced
from seldom import seldom

STEPS, DT, CHARGE = 6, 0.5, 2.0  # of mass 1
CASE = f"""
simulation = {{ cycles = {STEPS}; time_step = {DT}; space_length = [8.0, 4.0]; }};
grid = {{ points = [16, 4]; }};
species = ( {{ name = "ions"; particles = 64; charge = {CHARGE}; mass = 1.0; plasma_frequency = 1e-9; }} );
"""
BOXES = {
    1: ("simulation.space_length=[8.0]", "grid.points=[16]"),
    2: (),
    3: ("simulation.space_length=[8.0, 4.0, 2.0]", "grid.points=[16, 4, 4]"),
}
FIELDS = [  # dimensions and B: each kind of rotation that there is
    (2, (0.0, 0.0, 1.0)),
    (2, (-9.0, 12.0, 7.0)),
    (1, (0.6, 0.0, 0.8)),
    (3, (-9.0, 12.0, 7.0)),
]


def drifting(world, d, magnetic, turn, exact):
    """(velocity[step, 3] by theory, B/|B|, mass, scalars of each step) with wc dt = `turn` rad."""
    b = np.array(magnetic) / np.linalg.norm(magnetic)
    electric = np.array([0.3, -0.2, 0.5 if np.any(b[:2]) else 0.0])
    strength = turn / (CHARGE * DT)
    velocity = np.cross(electric, b) / strength + CHARGE * DT * np.outer(np.arange(STEPS + 1), (electric @ b) * b)
    sets = (f"field.magnetic={(strength * b).tolist()}", f"field.electric={electric.tolist()}",
            f"species[0].drift_velocity={velocity[0].tolist()}", f"numerics.exact_phase={exact}")  # fmt: skip
    plasma = advanced(CASE, world, (*BOXES[d], *sets), steps=0)
    values = [plasma.scalars()]
    for _ in range(STEPS):
        plasma.step()
        values.append(plasma.scalars())
    species = plasma.scene.species[0]
    plasma.close()
    return velocity, b, species.n * species.m, values


@pytest.mark.parametrize("d, magnetic", [FIELDS[0], *(seldom(*field) for field in FIELDS[1:])])
def test_with_an_exact_phase_the_energy_of_a_drift_is_that_of_the_force_too(world, d, magnetic):
    """|v-|^2 = |v|^2 + |f (q/m) E dt/2|^2 across B, where that is tan(wc dt/2) times the drift; along B it is v."""
    velocity, b, mass, values = drifting(world, d, magnetic, 1.0, True)
    along = velocity @ b
    squares = ((velocity**2).sum(axis=1) - along**2) / np.cos(0.5) ** 2 + along**2
    np.testing.assert_allclose([one["energy_kinetic"] for one in values], 0.5 * mass * squares, rtol=1e-9)


SELDOM = {(3, True), (3, False), (1, False)}  # kernels for this alone


@pytest.mark.parametrize(
    "d, magnetic, turn, exact",
    [
        pytest.param(*field, turn, exact, marks=[pytest.mark.validation] * ((field[0], exact) in SELDOM))
        for exact, turn in ((True, 1.0), (False, 2 * np.tan(np.pi / STEPS)))
        for field in FIELDS
    ],
)
def test_momenta_are_those_of_the_drift_and_of_the_fall_along_b(world, d, magnetic, turn, exact):
    """At each step with an exact phase. Else the start leaves a gyration, of which these are the steps of one turn."""
    velocity, _, mass, values = drifting(world, d, magnetic, turn, exact)
    found = np.array([[one["momentum_x"], one["momentum_y"]] for one in values]) / mass - velocity[:, :2]
    off = found if exact else found[1:].mean(axis=0)
    np.testing.assert_allclose(off, 0.0, rtol=0, atol=1e-9 * np.abs(velocity).max())
