"""Particles that drift by E x B / B^2 and fall along B: the series tells their motion, however far a step turns."""

import numpy as np
import pytest
from plasma_cases import advanced

STEPS, DT, CHARGE = 3, 0.5, 2.0  # of mass 1
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
    pytest.param(3, (-9.0, 12.0, 7.0), marks=pytest.mark.validation),
]


def drifting(world, d, magnetic, turn, exact):
    """(drift[3], way that it has fallen per second[3], mass, scalars) after some steps of wc dt = `turn` rad."""
    b = np.array(magnetic) / np.linalg.norm(magnetic)
    electric = np.array([0.3, -0.2, 0.5 if np.any(b[:2]) else 0.0])
    strength = turn / (CHARGE * DT)
    drift = np.cross(electric, b) / strength
    before = CHARGE * (electric @ b) * b * (-STEPS * DT)  # so that at the end it falls no more
    sets = (f"field.magnetic={(strength * b).tolist()}", f"field.electric={electric.tolist()}",
            f"species[0].drift_velocity={(drift + 2 * before).tolist()}", f"numerics.exact_phase={exact}")  # fmt: skip
    plasma = advanced(CASE, world, (*BOXES[d], *sets), steps=STEPS)
    values, species = plasma.scalars(), plasma.scene.species[0]
    plasma.close()
    return drift, before, species.n * species.m, values


@pytest.mark.parametrize("d, magnetic", FIELDS)
def test_with_an_exact_phase_the_energy_of_a_drift_is_that_of_the_force_too(world, d, magnetic):
    """|v-|^2 = |v|^2 + |f (q/m) E dt/2|^2 across B, where that is tan(wc dt/2) times the drift; along B it is v."""
    drift, along, mass, values = drifting(world, d, magnetic, 1.0, True)
    across = drift @ drift / np.cos(0.5) ** 2
    assert values["energy_kinetic"] == pytest.approx(0.5 * mass * (across + along @ along), rel=1e-9)
