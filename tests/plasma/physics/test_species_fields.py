"""Mistakes in a field of species of the user's own are told in one line with their place, before there is a run."""

import numpy as np
import pytest

from hpcpic.core.case.config import loads
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.configure import configure
from hpcpic.plasma.diagnostics import scalars
from hpcpic.plasma.physics import species_fields
from hpcpic.plasma.physics.moments import SPEED_SQUARED, VELOCITY, Moment
from hpcpic.plasma.physics.species_fields import SPECIES_FIELDS, SpeciesField, fault, register

CASE = """
simulation = { cycles = 1; time_step = 0.1; space_length = [8.0, 8.0]; };
grid = { points = [8, 8]; };
species = ({ name = "e"; particles = 64; charge = -1.0; mass = 1.0; });
output = { fields = ["rho", "T_x"]; };
"""
FACTOR = 2.0


def along_x(vx, vy, vz, square):
    return vx * vx


def two_values(vx, vy, vz, square):
    return vx, vy


def of_a_global(vx, vy, vz, square):
    return FACTOR * vx * vx


def with_if(vx, vy, vz, square):
    return vx if vx > 0.0 else 0.0


ALONG_X = Moment(along_x, power=2)


def temperature_x(sample):
    return sample.m * (sample[ALONG_X] - sample[VELOCITY][..., 0] ** 2)


def flow(sample):
    return sample.m * sample[VELOCITY]


def misspelt(sample):
    return sample.mass * sample[ALONG_X]


def of_another_moment(sample):
    return sample[SPEED_SQUARED]


def total(sample):
    return sample[ALONG_X].sum()


def field(value, moments=(ALONG_X, VELOCITY), **more):
    return SpeciesField("T_x", "J", value, moments, **more)


@pytest.mark.parametrize("components", [2, 3])
@pytest.mark.parametrize("sound", [field(temperature_x), field(flow, vector=True), *SPECIES_FIELDS.values()])
def test_a_sound_field_has_no_fault(sound, components):
    assert fault(sound, 2, components) == ""


@pytest.mark.parametrize(
    ("wrong", "function", "line", "told"),
    [
        (field(misspelt), misspelt, 1, "AttributeError: 'NodeSample' object has no attribute 'mass'"),
        (field(of_another_moment), species_fields.NodeSample.__getitem__, None, "speed_squared is none of the moments"),
        (field(total), total, 0, "must return numbers [8, 8] for a sample of [8, 8] nodes (it returns"),
        (field(flow), flow, 0, "[8, 8] for a sample of [8, 8] nodes (it returns float64 [8, 8, 3])"),
        (field(temperature_x, vector=True), temperature_x, 0, "must return numbers [8, 8, 3]"),
        (field(total, (ALONG_X, Moment(two_values, 1))), two_values, 0, "must return one value"),
    ],
)
def test_a_mistake_is_told_in_one_line_with_its_place(monkeypatch, wrong, function, line, told):
    monkeypatch.setattr(species_fields, "files", {__file__})
    said = fault(wrong, 2, 3)
    assert told in said and "\n" not in said
    if line is None:  # where the user's function asked for it
        line, function = 1, wrong.value
    assert said.startswith(f"{__file__}:{function.__code__.co_firstlineno + line}: {function.__name__}: ")


def test_an_integrand_of_more_than_its_arguments_is_not_registered():
    with pytest.raises(ValueError, match=r"field 'T_x': .*of_a_global: is to be arithmetic .*'FACTOR'"):
        register(field(total, (Moment(of_a_global, 2),)))
    assert "T_x" not in SPECIES_FIELDS


@pytest.mark.parametrize("name", ["n", "T", "E"])
def test_a_name_belongs_to_one_field(name):
    with pytest.raises(ValueError, match=f"another field '{name}': give yours another name"):
        register(SpeciesField(name, "J", total))


def test_a_case_that_names_it_is_refused_and_one_that_does_not_is_not(monkeypatch):
    monkeypatch.setitem(SPECIES_FIELDS, "T_x", field(total))
    with pytest.raises(ConfigError, match=r"output\.fields: T_x: .*total: must return numbers"):
        configure(loads(CASE))
    configure(loads(CASE.replace(', "T_x"', "")))


def test_a_scalar_is_refused_that_vectors_cannot_be_summed_by(monkeypatch):
    """A field of species is summed number by number, and may have it."""
    moment = Moment(with_if, 1)
    mine = scalars.Scalar("mine", "m/s", lambda sample: sum(s[moment] for s in sample.species), (moment,))
    monkeypatch.setattr(scalars, "SCALARS", {"mine": mine})
    with pytest.raises(ConfigError, match=r"output: scalar 'mine': .*with_if: cannot be compiled: .*bool\(Vec"):
        configure(loads(CASE.replace(', "T_x"', "")))
    assert fault(field(lambda sample: np.ones_like(sample.density), (moment,)), 2, 3) == ""
