"""Laws of the wall rules, evaluated by numpy; test_fixed_links compares the compiled ones with these."""

import sys

import numpy as np
import pytest

from hpcpic.core.case.own_functions import formula_fault
from hpcpic.core.errors import ConfigError
from lbmdem import Case
from lbmdem.physics import wall_rules
from lbmdem.physics.wall_rules import OWN, RULES, WallRule, applicable, begun, coefficients, finished

Q = np.linspace(0.01, 1.0, 34)
BY_NAME = pytest.mark.parametrize("rule", RULES.values(), ids=lambda rule: rule.name)


def test_their_numbers_are_their_places():
    assert [rule.number for rule in RULES.values()] == list(range(len(RULES)))


@BY_NAME
def test_a_rule_leaves_a_fluid_alone_that_moves_with_the_wall(rule):
    gi_x, gi_y, gj_x, gi_z, gj_y, push = coefficients(rule.number, Q)
    np.testing.assert_allclose(gi_x + gi_y + gj_x + gi_z + gj_y, 1.0, atol=1e-14)  # a few roundings of numbers near 1
    np.testing.assert_allclose(push, 1.0 - gj_x - gj_y, atol=1e-14)


@BY_NAME
def test_rules_meet_half_way(rule):
    assert coefficients(rule.number, 0.5) == pytest.approx((1, 0, 0, 0, 0, 1), abs=1e-15)


@BY_NAME
def test_a_rule_reads_no_further_than_its_reach_and_a_simpler_one_less(rule):
    _, gi_y, gj_x, gi_z, gj_y, _ = np.array([coefficients(rule.number, q) for q in Q]).T
    assert rule.reach == (2 if gi_z.any() or gj_y.any() else 1 if gi_y.any() or gj_x.any() else 0)
    assert [RULES[name].number for name in RULES][applicable(rule.number, 2)] == rule.number
    for behind in range(rule.reach):
        assert list(RULES.values())[applicable(rule.number, behind)].reach <= behind


@BY_NAME
def test_the_impedance_is_of_the_mean_coefficient_of_the_push(rule):
    q = (np.arange(4096) + 0.5) / 4096
    mean = np.mean([coefficients(rule.number, place)[5] for place in q])
    assert mean == pytest.approx(rule.mean_push, rel=1e-6)  # of the midpoint rule, with a kink at one of its edges


def test_the_two_parts_of_cli_are_the_whole():
    gi_x, gi_y, gj_x = np.random.default_rng(0).normal(size=(3, len(Q)))
    one, kappa, minus_kappa, *_ = coefficients(RULES["cli"].number, Q)
    np.testing.assert_allclose(minus_kappa, -kappa)
    whole = one * gi_x + kappa * gi_y + minus_kappa * gj_x
    np.testing.assert_allclose(finished(kappa, gi_y, begun(kappa, gi_x, gj_x)), whole, atol=1e-15)


def with_if(q, gi_x, gi_y, gj_x, push):
    return gi_x - push if q < 0.5 else gi_y - push


@pytest.mark.parametrize("formula", [wall_rules.cli, wall_rules.interpolated])
def test_the_shipped_formulas_pass_what_those_of_users_must(formula):
    names = ("q", "gi_x", "gi_y", "gj_x", "push")
    assert formula_fault(formula, names) == formula_fault(formula, (), names) == ""


def test_a_name_belongs_to_one_rule(monkeypatch):
    monkeypatch.delitem(sys.modules, "lbmdem.kernels", raising=False)  # as before the first simulation
    with pytest.raises(ValueError, match="another wall rule 'halfway': give yours another name"):
        wall_rules.register("halfway", wall_rules.cli)
    assert RULES["halfway"].reach == 0


def test_a_rule_that_vectors_cannot_be_taken_by_is_refused_with_its_place(monkeypatch):
    """At a link that stays it is evaluated with numbers, at the surface of a grain with vectors."""
    monkeypatch.setitem(RULES, "mine", WallRule("mine", OWN, 1, 0, 3, 1.0))
    monkeypatch.setattr(wall_rules, "own", with_if)
    with pytest.raises(ConfigError, match=r"bounce_back: .*test_wall_rules.py:\d+: with_if: .*bool\(Vec"):
        Case("settling-disc").changed({"coupling.bounce_back": "mine"})
