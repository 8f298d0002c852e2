"""What is written out of habit: synonyms, other units, cases of another program, misspelt verbs."""

import re
from importlib import import_module

import pytest
from click.testing import CliRunner

from hpcpic.core.case import cases, schema
from hpcpic.core.case.config import load, loads
from hpcpic.core.case.dump import dump
from hpcpic.core.case.schema import describe
from hpcpic.core.case.words import VISCOSITIES, unknown
from hpcpic.core.cli.main import ALIASES, VERBS, build
from hpcpic.core.errors import ConfigError
from lbmdem.forecast.estimate import output_periods

MODULES = {"hpcpic": "hpcpic.plasma.app", "sph": "sph.app", "lbmdem": "lbmdem.app"}
SHIPPED = {"hpcpic": "two-particles", "sph": "poiseuille", "lbmdem": "poiseuille"}


def app(program):
    return import_module(MODULES[program]).APP


def text_of(program):
    return app(program).cases()[SHIPPED[program]].read_text()


def read(program, text=None, sets=()):
    tree = loads(text or text_of(program), sets=sets)
    return app(program).configure(tree), tree


def faults_of(program, *sets, text=None):
    with pytest.raises(ConfigError) as caught:
        read(program, text, sets)
    return caught.value.messages


@pytest.mark.parametrize("program", MODULES)
def test_what_the_programs_cases_are_made_of_is_what_their_schemas_say(program):
    assert cases.PROGRAMS[program] == set(app(program).schema().model_fields)


@pytest.mark.parametrize(
    "program, key, meant",
    [
        ("hpcpic", "simulation.steps", "simulation.cycles"),
        ("hpcpic", "simulation.dt", "simulation.time_step"),
        ("hpcpic", "dt", "simulation.time_step"),
        ("hpcpic", "simulation.end", "simulation.cycles"),
        ("hpcpic", "simulation.tmax", "simulation.cycles"),
        ("hpcpic", "grid.dx", "grid.points"),
        ("hpcpic", "simulation.resolution", "grid.points"),
        ("hpcpic", "simulation.seed", "simulation.random_seed"),
        ("sph", "simulation.steps", "simulation.end_time"),
        ("sph", "simulation.dt", "simulation.time_step"),
        ("sph", "fluid[0].nu", "fluid[0].kinematic_viscosity"),
        ("sph", "fluid[0].mu", "fluid[0].dynamic_viscosity"),
        ("sph", "numerics.viscosity", "fluid[].kinematic_viscosity"),
        ("sph", "fluid[0].rho0", "fluid[0].density"),
        ("sph", "simulation.end", "simulation.end_time"),
        ("sph", "tmax", "simulation.end_time"),
        ("sph", "numerics.dx", "numerics.spacing"),
        ("sph", "simulation.resolution", "numerics.spacing"),
        ("sph", "simulation.gravity", "gravity"),
        ("lbmdem", "simulation.steps", "simulation.end_time"),
        ("lbmdem", "fluid.dt", "fluid.time_step"),
        ("lbmdem", "fluid.nu", "fluid.kinematic_viscosity"),
        ("lbmdem", "fluid.mu", "fluid.dynamic_viscosity"),
        ("lbmdem", "simulation.viscosity", "fluid.kinematic_viscosity"),
        ("lbmdem", "fluid.rho0", "fluid.density"),
        ("lbmdem", "domain.dx", "domain.spacing"),
        ("lbmdem", "simulation.gravity", "gravity"),
    ],
)
def test_common_words_lead_to_the_key(program, key, meant):
    (message,) = faults_of(program, f"{key}=1.0")
    assert f"{key}: unknown key; did you mean {meant!r}" in message
    rows = {row.key for row in describe(app(program).schema())} | set(app(program).schema().rewritten)
    assert re.sub(r"\[\d\]", "[]", meant) in rows


def test_a_synonym_that_is_a_key_elsewhere_is_meant_within_its_group_only():
    asked = 'gauge=({what = "pressure"; at = [0.1, 0.1]; type = 1; position = 1;})'
    told = "\n".join(faults_of("sph", asked, "fluid[0].type=1"))
    assert "gauge[0].type: unknown key; did you mean 'gauge[0].what'?" in told
    assert "gauge[0].position: unknown key; did you mean 'gauge[0].at'?" in told
    assert "fluid[0].type: unknown key; did you mean 'fluid[].flow.type'?" in told


def test_many_unknown_keys_are_compared_a_bounded_number_of_times(monkeypatch):
    asked = []
    monkeypatch.setattr(schema, "nearest_key", lambda model, path: asked.append(path) or "")
    messages = faults_of("hpcpic", text=text_of("hpcpic") + "".join(f"k{i} = 1;\n" for i in range(16000)))
    assert len(asked) == schema.MOST_TOLD and messages[-1] == "and 15900 more"


FLUID = {"sph": "fluid[0]", "lbmdem": "fluid"}
OWN = {"sph": "dynamic_viscosity", "lbmdem": "kinematic_viscosity"}


def viscosity(program, text):
    config, tree = read(program, text)
    fluid = config.fluid[0] if program == "sph" else config.fluid
    assert app(program).configure(loads(dump(config))) == config
    return getattr(fluid, OWN[program]), tree.warnings


@pytest.mark.parametrize("program", FLUID)
def test_both_viscosities_are_understood_and_the_bare_word_says_what_it_was_taken_for(program):
    own, old = OWN[program], text_of(program)
    (other,) = set(VISCOSITIES) - {own}
    density = 500.0
    old = re.sub(r"(?<!\w)density = \S+;", "", old).replace(own, f"density = {density}; {own}")
    asked = float(re.search(rf"{own} = (\S+);", old)[1])
    factor = density if own == "dynamic_viscosity" else 1 / density
    assert viscosity(program, old) == (asked, [])
    assert viscosity(program, old.replace(own, other)) == (pytest.approx(factor * asked, rel=1e-15), [])
    value, (warning,) = viscosity(program, old.replace(own, "viscosity"))
    assert value == asked and f"{FLUID[program]}.viscosity: taken for the {own.replace('_', ' ')} in" in warning
    assert all(f"{word} ({unit})" in warning for word, unit in VISCOSITIES.items())


@pytest.mark.parametrize("program", FLUID)
def test_a_set_viscosity_wins_over_that_of_the_file_and_two_in_one_file_are_refused(program):
    own = OWN[program]
    for word in ("viscosity", own):
        config, _ = read(program, sets=[f"{FLUID[program]}.{word}=0.25"])
        assert getattr(config.fluid[0] if program == "sph" else config.fluid, own) == 0.25
    (other,) = set(VISCOSITIES) - {own}
    (message,) = faults_of(program, text=text_of(program).replace(own, f"{other} = 1.0; {own}"))
    assert "give either this or" in message and other in message and own in message
    (message,) = faults_of(program, f"{FLUID[program]}.{other}=-1.0")
    assert own in message and "must be greater" in message
    assert faults_of(program, f'{FLUID[program]}.{other}="x"') and faults_of(program, f"{FLUID[program]}.density=0")


@pytest.mark.parametrize(
    "program, kind, seconds",
    [("sph", "series", 0.01), ("sph", "particles", 0.02), ("lbmdem", "fields", 0.01), ("lbmdem", "checkpoint", 0.02)],
)
def test_a_period_is_in_seconds_or_in_steps(program, kind, seconds):
    in_seconds, _ = read(program, sets=[f"output.period.{kind}={seconds}"])
    assert getattr(in_seconds.output.period, kind) == seconds and getattr(in_seconds.output.every, kind) is None
    in_steps, _ = read(program, sets=[f"output.every.{kind}=7"])
    assert getattr(in_steps.output.period, kind) is None and getattr(in_steps.output.every, kind) == 7
    for config in (in_seconds, in_steps):
        again, tree = read(program, dump(config))
        assert again == config and tree.warnings == []
    both = f"\nmore = {{ period = {{ {kind} = 0.1; }}; every = {{ {kind} = 7; }}; }};"
    plain = re.sub(r"(?m)^output = .*$", "", text_of(program))
    (message,) = faults_of(program, text=plain + both.replace("more", "output"))
    assert "give either this or output.period" in message
    assert "must be greater than or equal to 0" in faults_of(program, f"output.every.{kind}=-1")[0]


def test_periods_in_steps_and_in_seconds_are_one_where_steps_are_of_one_length():
    step = read("lbmdem")[0].time_step
    for kind, name in {"series": "series", "fields": "field", "checkpoint": "checkpoint"}.items():
        for asked in (f"output.every.{kind}=7", f"output.period.{kind}={7 * step!r}"):
            assert output_periods(read("lbmdem", sets=[asked])[0])[name] == 7


@pytest.mark.parametrize("program", MODULES)
@pytest.mark.parametrize("other", MODULES)
def test_a_case_of_another_program_is_named(tmp_path, program, other):
    for name, path in app(other).cases().items():
        if other == program:
            app(program).configure(load(path))
            continue
        with pytest.raises(ConfigError) as caught:
            app(program).configure(load(path))
        assert caught.value.messages == [f"{path}:1:1: this is a case of {other}; run: {other} check {path}"], name


@pytest.mark.parametrize("program", MODULES)
def test_what_is_no_case_is_told_in_a_line_without_its_keys(program):
    (message,) = faults_of(program, text="password = 1;\nuser = 2;")
    assert message.startswith("case:1:1: no case: it has none of the keys") and "password" not in message


@pytest.mark.parametrize(
    "verb, meant", [("plt", "plot"), ("stab", "stability"), ("resume", "restart"), ("simulate", "run"), ("xyz", "")]
)
def test_a_misspelt_verb_is_answered_with_the_nearest(verb, meant):
    done = CliRunner().invoke(build(lambda: app("sph"), "sph", "x"), [verb])
    told = f"did you mean {meant!r}?" if meant else "there are list, show, check"
    assert done.exit_code == 2 and told in done.output


def test_the_words_of_others_lead_to_verbs_and_are_none():
    assert set(ALIASES.values()) <= set(VERBS) and not set(ALIASES) & set(VERBS)


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("specie[0].charge=1.0", "there is no specie; did you mean species?"),
        ("elephants[0].charge=1.0", "there is no elephants"),
        ("species.charge=1.0", "species is a list of 1; its groups are species[0], species[1], ..."),
        ("species.ions.charge=1.0", "there is no species.ions: species is a list of 1; 'ions' is species[0]"),
        ("species[7].charge=1.0", "there is no species[7]: species has 1; to add one give the whole list, species"),
    ],
)
def test_a_setting_of_a_list_that_is_not_there_has_the_one_that_was_meant(assignment, said):
    (fault,) = loads('species = ({ name = "ions"; charge = -1.0; });', sets=(assignment,)).faults
    assert fault.endswith(said)


def test_a_name_is_suggested_only_where_it_is_like_what_was_written():
    assert "did you mean" not in unknown("speed", ["velocity", "pressure"])
    assert unknown("velocty", ["velocity", "pressure"]).endswith("did you mean 'velocity'?")
