"""Typed configurations: every fault with its place at once, and text that reads back to the same instance."""

from typing import ClassVar, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpcpic.core.case.config import load, loads
from hpcpic.core.case.derived import Derived, enforce
from hpcpic.core.case.dump import dump
from hpcpic.core.case.schema import REQUIRED, Counts, Section, Vector, describe, setting, validate
from hpcpic.core.errors import ConfigError


class Part(Section):
    name: str = setting("", "name")
    mass: float = setting(REQUIRED, "mass", "kg", gt=0)
    position: Vector = setting((), "place", "m")


class Group(Section):
    count: int = setting(3, "how many", ge=1)
    colour: Literal["red", "green"] = setting("red", "colour")
    switch: bool = setting(False, "switch")
    shape: Counts | None = setting(None, "points", max_length=2)


class Model(Section):
    ignored: ClassVar[tuple[str, ...]] = ("viewer", "group.old", "part.old")

    title: str = setting("", "title")
    group: Group = Group()
    part: tuple[Part, ...] = ()
    limit: float | None = setting(None, "limit")


def bad_names(config: Model):
    return ((("part", i, "name"), "is bad") for i, part in enumerate(config.part) if part.name == "bad")


def faults_of(text: str, sets=()) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        validate(Model, loads(text, sets=sets), bad_names)
    assert caught.value.exit_code == 2
    return caught.value.messages


def test_every_fault_is_told_at_once_with_its_place():
    messages = faults_of(
        """title = 3;
group = { count = 0; colour = "rad"; switch = 1; shpe = [1]; count = 2; };
part = ( { name = "a"; mass = -1.0; },
         { mas = 1.0; position = [1, "x"]; } );
limit = 1e999;
mass = 1.0;
""",
        sets=["limit=true", "group.colour=blue"],
    )
    expected = [
        "case:2:62: group.count: set twice, first at case:2:11",
        "case:4:34: the values of an array [ ] must be of one type; use a list ( )",
        "case:5:9: the number 1e999 is too large (the largest is 1.79e308)",
        'case:1:1: title: must be a text in " " (got 3)',
        "case:2:11: group.count: must be greater than or equal to 1 (got 0)",
        "--set group.colour=blue: group.colour: must be 'red' or 'green' (got 'blue')",
        "case:2:38: group.switch: must be true or false (got 1)",
        "case:2:50: group.shpe: unknown key; did you mean 'shape'?",
        "case:3:24: part[0].mass: must be greater than 0 (got -1.0)",
        "case:4:10: part[1].mass: missing, and there is no default",
        "case:4:38: part[1].position[1]: must be a number (got 'x')",
        "case:4:12: part[1].mas: unknown key; did you mean 'mass'?",
        "--set limit=true: limit: must be a number (got true)",
        "case:6:1: mass: unknown key; did you mean 'part[].mass'?",
    ]
    assert sorted(messages) == sorted(expected)


def test_a_key_that_is_like_no_other_is_answered_with_those_that_there_are():
    (told,) = faults_of("group = { zzz = 1; };")
    assert told.startswith("case:1:11: group.zzz: unknown key; there are count, ") and told.endswith("shape"), told


def test_faults_are_told_in_the_order_of_the_file():
    messages = faults_of("title = 3;\npart = ({ mass = -1; });\ngroup = { shpe = 1; count = 0; };")
    places = [message.split(": ")[0] for message in messages]
    assert places == ["case:1:1", "case:2:11", "case:3:11", "case:3:21"]


def test_keys_are_not_called_missing_when_an_include_failed(tmp_path):
    path = tmp_path / "case.conf"
    path.write_text('part = ({ @include "nowhere.conf" });\n')
    with pytest.raises(ConfigError) as caught:
        validate(Model, load(path))
    assert [message.split(": ", 1)[1][:11] for message in caught.value.messages] == ["cannot read"]


def test_a_wrong_word_is_answered_with_the_nearest():
    (message,) = faults_of('group = { colour = "gren"; };')
    assert message == "case:1:11: group.colour: must be 'red' or 'green' (got 'gren'); did you mean 'green'?"
    assert faults_of('group = { colour = "GREEN"; };')[0].endswith("(got 'GREEN'); did you mean 'green'?")


def test_a_key_named_with_its_group_is_found_there():
    (message,) = faults_of('title = "t"; inner_group_colour = 1;')
    assert message.endswith("did you mean 'group.colour'?")


def test_a_group_where_a_value_belongs_and_the_reverse():
    (first,) = faults_of("title = { a = 1; };")
    assert first.endswith('title: must be a text in " " (got a group { })')
    (second,) = faults_of("group = 3;")
    assert second.startswith("case:1:1: group: must be a group { }")
    (third,) = faults_of("part = { mass = 1; };")
    assert third.startswith("case:1:1: part: must be a list ( )")


def test_a_lone_value_for_a_vector_is_named_by_its_key():
    assert faults_of("part = ({ mass = 1; position = true; });")[0].startswith(
        "case:1:21: part[0].position: must be a number (got true)"
    )
    assert faults_of('part = ({ mass = 1; position = "x"; });')[0].endswith("must be a number (got 'x')")


def test_faults_between_settings_are_placed_too():
    assert faults_of('part = ({ name = "bad"; mass = 1; });') == ["case:1:11: part[0].name: is bad"]


def test_a_long_or_hostile_value_is_shown_in_one_harmless_line():
    (message,) = faults_of('group = { colour = "\\x1b[31m' + "z" * 200 + '"; };')
    assert "\x1b" not in message and "\n" not in message and len(message) < 200


def test_an_integer_widens_to_float_and_nothing_else_converts():
    config = validate(Model, loads("part = ({ mass = 2; position = 3; }); limit = 4;"))
    assert type(config.part[0].mass) is float and config.part[0].position == (3.0,) and type(config.limit) is float
    for text in ("group = { count = 1.5; };", 'limit = "1";', "limit = true;", "group = { count = true; };"):
        faults_of(text)


def test_a_number_without_a_fraction_is_an_integer_where_one_is_asked_for():
    """Exponents are how one writes many steps; libconfig calls 1e4 a float."""
    text = "group = { count = 1e4; shape = (2e1, 3); }; part = ({ mass = 1e4; }); limit = 1e4;"
    config = validate(Model, loads(text))
    assert config.group.count == 10000 and config.group.shape == (20, 3)
    assert {type(value) for value in (config.group.count, *config.group.shape)} == {int}
    assert type(config.part[0].mass) is float and type(config.limit) is float
    assert validate(Model, loads("group = { shape = 2e1; };", sets=["group.count=2e0"])).group == Group(
        count=2, shape=(20,)
    )
    assert validate(Model, loads(dump(config))) == config


@pytest.mark.parametrize("value", ["1.5", "1e-1", "1e300", "-1e4", "[1e4]", "true"])
def test_other_numbers_are_no_integers(value):
    (message,) = faults_of(f"group = {{ count = {value}; }};")
    assert message.startswith("case:1:11: group.count: must be ")


def test_configurations_are_frozen():
    with pytest.raises(AttributeError, match=r"title: a configuration never changes; case\.changed"):
        validate(Model, loads("")).title = "x"


def test_ignored_keys_give_one_warning():
    tree = loads("viewer = { a = 1; }; group = { old = 1; }; part = ({ mass = 1; }, { mass = 1; old = 2; });")
    validate(Model, tree)
    assert tree.warnings == ["keys without meaning here, ignored: viewer, group.old, part[1].old"]
    assert faults_of("older = 1;")  # only those: any other unknown key is an error


numbers = st.floats(allow_nan=False, allow_infinity=False)
models = st.builds(
    Model,
    title=st.text(st.characters(codec="latin-1"), max_size=20),
    group=st.builds(
        Group,
        count=st.integers(1, 2**62),
        colour=st.sampled_from(["red", "green"]),
        switch=st.booleans(),
        shape=st.none() | st.lists(st.integers(1, 99), min_size=1, max_size=2).map(tuple),
    ),
    part=st.lists(
        st.builds(
            Part,
            name=st.text('ab \\"\n', max_size=5),
            mass=st.floats(1e-300, 1e300),
            position=st.lists(numbers, max_size=3).map(tuple),
        ),
        max_size=3,
    ).map(tuple),
    limit=st.none() | numbers,
).filter(lambda model: "\0" not in model.title)


@given(models)
def test_dump_reads_back_to_the_same_configuration(model):
    assert validate(Model, loads(dump(model))) == model


def test_comments_stand_at_their_keys_after_the_unit():
    model = Model(group=Group(), part=(Part(mass=1.0), Part(mass=2.0)))
    lines = dump(model, {"title": "top", "group.count": "inner", "part[1].mass": "second"}).splitlines()
    found = {line.strip() for line in lines if "#" in line}
    assert {'title = "";  # top', "count = 3;  # inner", "mass = 2.0;  # kg, second", "mass = 1.0;  # kg"} <= found
    assert sum("second" in line for line in lines) == 1


def test_describe_lists_type_unit_default_and_limits():
    rows = {row.key: row for row in describe(Model)}
    assert list(rows)[:3] == ["title", "group.count", "group.colour"]
    mass = rows["part[].mass"]
    assert (mass.type, mass.unit, mass.default, mass.limits) == ("number", "kg", "required", "> 0")
    assert rows["group.colour"].type == '"red"|"green"' and rows["group.count"].default == "3"


def test_a_refusal_stops_the_run_unless_it_can_be_forced():
    tree = loads("group = {\n count = 3; };")
    numbers = [
        Derived("a", "A", 1.0),
        Derived("b", "B", 2.0, "m", "< 1", "warn", "book", "less", forceable=True),
        Derived("c", "C", 3.0, "", "< 2", "fail", "book", "count = 1", ("group", "count"), forceable=True),
        Derived("d", "D", 4.0, "", "< 2", "fail", "book", "no", ("group", "colour")),
    ]
    with pytest.raises(ConfigError) as caught:
        enforce(numbers, tree)
    assert caught.value.messages == [
        "case:2:2: group.count: c C = 3 (limit < 2; book): count = 1 (--force runs it, in Python force=True)",
        "case:1:1: group.colour: d D = 4 (limit < 2; book): no",
    ]
    with pytest.raises(ConfigError) as caught:
        enforce(numbers, tree, force=True)
    assert len(caught.value.messages) == 1
    assert enforce(numbers[:3], tree, force=True) == [
        "b B = 2 m (limit < 1; book): less",
        "c C = 3 (limit < 2; book): count = 1 (refused without --force)",
    ]
