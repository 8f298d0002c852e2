"""Discs start from the arrays of other discs, in two components or in three, as they are read."""

import numpy as np
import pytest

import hpcpic
import lbmdem

PLANE = np.array([[2e-3, 3e-3], [5e-3, 5.2e-3], [8e-3, 4e-3]])
START = {"position": PLANE, "diameter": np.full(3, 1e-3), "velocity": 1e-2 * PLANE, "angular_velocity": PLANE[:, :1]}
WHOLE = {name: np.pad(START[name], ((0, 0), (0, 1))) for name in ("position", "velocity")}
WHOLE |= {"diameter": START["diameter"], "angular_velocity": np.pad(START["angular_velocity"], ((0, 0), (2, 0)))}


def discs(start, **more):
    simulation, domain = {"dimensions": 2, "end_time": 1e-3}, {"size": [1e-2, 1e-2]}
    return lbmdem.Case(simulation=simulation, domain=domain, grains=[{"name": "g", "start": start}], **more)


def test_vectors_may_have_three_components_as_they_are_read():
    with discs(START).simulation(threads=1) as plane, discs(WHOLE).simulation(threads=1) as whole:
        plane.advance(steps=5)
        whole.advance(steps=5)
        assert plane.digest() == whole.digest()
        read = {name: plane.particles("g")[name].values for name in ("position", "velocity", "angular_velocity")}
    again = discs(START).changed({"grains[0].start": read | {"diameter": START["diameter"]}})
    with again.simulation(threads=1) as sim:
        for name, values in read.items():
            np.testing.assert_array_equal(sim.particles("g")[name].values, values)


@pytest.mark.parametrize(
    "name, component, told",
    [
        ("position", 2, "position must be 0 in z"),
        ("velocity", 2, "velocity must be 0 in z"),
        ("angular_velocity", 0, "angular_velocity must be 0 in x and y"),
    ],
)
def test_components_out_of_the_plane_are_refused(name, component, told):
    wrong = WHOLE[name].copy()
    wrong[1, component] = 1e-3
    with pytest.raises(hpcpic.ConfigError, match=rf"^lbmdem.Case: grains\[0\].start: {told} in this box"):
        discs(WHOLE | {name: wrong})
    with pytest.raises(hpcpic.ConfigError, match=r"^lbmdem.Case: grains\[0\].start: position must have the shape"):
        discs(WHOLE | {"position": PLANE[:, :1]})


def test_a_start_without_grains_is_refused():
    with pytest.raises(hpcpic.ConfigError, match=r"grains\[0\].start: there are no grains in it"):
        discs({"position": PLANE[:0], "diameter": np.zeros(0)})
