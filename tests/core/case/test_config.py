"""The reader of case files: what libconfig says, where every setting stands, and no input that breaks it."""

import os
import string

import libconf
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hpcpic.core.case import config
from hpcpic.core.case.config import leaves, load, loads, parse_value
from hpcpic.core.errors import ConfigError

names = st.from_regex(r"[A-Za-z][-A-Za-z0-9_]{0,8}", fullmatch=True).filter(
    lambda name: name.lower() not in ("true", "false")
)
integers = st.integers(-(2**63), 2**63 - 1)
floats = st.floats(allow_nan=False, allow_infinity=False)
texts = st.text(string.ascii_letters + string.digits + ' ."\\\n\t/#*{}[]();,é', max_size=12)
scalars = st.one_of(st.booleans(), integers, floats, texts)
arrays = st.one_of(*(st.lists(kind, max_size=5) for kind in (st.booleans(), integers, floats, texts)))
values = st.recursive(
    st.one_of(scalars, arrays),
    lambda inner: st.one_of(st.lists(inner, max_size=4).map(tuple), st.dictionaries(names, inner, max_size=4)),
    max_leaves=12,
)
groups = st.dictionaries(names, values, max_size=5)


@given(groups)
def test_reads_what_libconf_writes_and_reads(group):
    text = libconf.dumps(group)
    tree = loads(text)
    assert tree.faults == []
    assert tree.data == group == libconf.loads(text)


def test_every_notation_of_libconfig():
    tree = loads("""
        a = 42; b : -3L, h = 0x1F; n = 0b101; o = 0o17; q = 0q17; z = 007  # comment
        f = 1.5e-3 // comment
        g = .5; e = 3E2; /* a
        longer comment */ t = TrUe; s = "x\\ty" "z\\x41"
        "\\"" ;
        array = [1, 2.5, 3,]; empty = []; list = (1, "two", [3], { four = 4; },); none = ();
        nested : { deeper = { value = 1 } }
    """)
    assert tree.faults == []
    assert tree.data == {
        "a": 42,
        "b": -3,
        "h": 31,
        "n": 5,
        "o": 15,
        "q": 15,
        "z": 7,
        "f": 1.5e-3,
        "g": 0.5,
        "e": 300.0,
        "t": True,
        "s": 'x\tyzA"',
        "array": [1, 2.5, 3],
        "empty": [],
        "list": (1, "two", [3], {"four": 4}),
        "none": (),
        "nested": {"deeper": {"value": 1}},
    }
    assert type(tree.data["t"]) is bool and type(tree.data["array"][0]) is int


@pytest.mark.parametrize(
    "text, message",
    [
        ("a = 1\nb = ;", "2:5: expected a value"),
        ("a = 1 b = 2;", "1:7: missing ; after the value of 'a'"),
        ("a = 1;\nb = 5ns;", "2:5: '5ns' is not a number"),
        ("a = 1;\nb = 5.0 ns;", "2:9: found 'ns' after a number, which stands alone"),
        ("g = { a = 3*0.01; }", "1:12: found '*0' after a number, which stands alone"),
        ("a = 0,03;", "1:6: found a comma in a number: decimals have a point"),
        ("a = yes;", "found 'yes': texts stand in quotes"),
        ("g = {\n a = 1;\n", "1:5: missing '}' for this '{'"),
        ("v = [1, 2;", "1:10: expected , or ]"),
        ("v = (1, 2", "1:5: missing ')' for this '('"),
        ("g = { a = 1; } }", "1:16: expected a setting"),
        ("a.b = 3;", "1:2: expected = after the name"),
        ('s = "open\n;', "1:5: the string does not end on its line"),
        ("/* open", "1:1: the comment does not end"),
        ("a = ", "expected a value"),
        ("a = 1_0;", "1:5: '1_0' is not a number"),
        ("a = nan;", "1:5: expected a value"),
        ("a = inf;", "1:5: expected a value"),
        ("@include 3", '1:10: expected the "file name"'),
        ("x = \x07;", "1:5: forbidden character U+0007"),
        ("x = 1; # \u202eback", "1:10: forbidden character U+202E"),
        ("x = \u0663;", "1:5: expected a value"),
        ("(" * 40, "expected a setting"),
        ("a = " + "(" * 40, "1:37: nested deeper than 32"),
    ],
)
def test_syntax_is_refused_with_its_place(text, message):
    try:
        faults = loads(text).faults
    except ConfigError as error:
        faults = error.messages
    assert any(message in fault for fault in faults), faults


@pytest.mark.parametrize(
    "text, message",
    [
        ("a = 1;\na = 2;", "case:2:1: a: set twice, first at case:1:1"),
        ("g = { a = 1; b = 2; a = 3; };", "case:1:21: g.a: set twice"),
        ("g = { a = 1; }; g = { b = 2; };", "case:1:17: g: set twice"),
        ('v = [1, "x"];', "case:1:5: the values of an array [ ] must be of one type"),
        ("v = [1, true];", "case:1:5: the values of an array [ ] must be of one type"),
        ("v = [(1)];", "case:1:5: an array [ ] holds only"),
        ("x = 99999999999999999999;", "case:1:5: the integer"),
        ("x = 1e999;", "case:1:5: the number"),
        ("x = -1e999;", "case:1:5: the number"),
        ('s = "\\q";', "case:1:5: unknown escape"),
    ],
)
def test_faults_of_meaning_do_not_hide_each_other(text, message):
    tree = loads(text + " z = 1e400;")
    assert message in tree.faults[0] or message in tree.faults[1]
    assert len(tree.faults) == 2


def test_a_setting_ends_with_its_line_or_with_a_separator():
    assert loads("a = 1\nb = 2, c = 3; d = [1]\n").data == {"a": 1, "b": 2, "c": 3, "d": [1]}
    assert loads("g = {\n a = 1 }").faults == []


def test_every_setting_keeps_its_place():
    tree = loads("a = 1;\ng = {\n\tb = (1,\n  { c = 2; });\n};\n")
    place = {key: str(tree.where(key)) for key in (("a",), ("g", "b"), ("g", "b", 1, "c"), ("g", "b", 1, "missing"))}
    assert list(place.values()) == ["case:1:1", "case:3:2", "case:4:5", "case:4:3"]


def write(folder, **files):
    for name, text in files.items():
        (folder / f"{name}.conf").write_text(text)
    return folder / "main.conf"


def test_a_later_file_merges_key_by_key(tmp_path):
    main = write(
        tmp_path,
        main='@include "base.conf"\ng = { b = 20; };\nlist = (3);\n@include "last.conf"\n',
        base="g = { a = 1; b = 2; };\nlist = (1, 2);\nh = 1;\n",
        last="h = { x = 1; };\n",
    )
    tree = load(main)
    assert tree.faults == []
    assert tree.data == {"g": {"a": 1, "b": 20}, "list": (3,), "h": {"x": 1}}
    assert str(tree.where(("g", "a"))) == f"{tmp_path}/base.conf:1:7"
    assert str(tree.where(("g", "b"))) == f"{main}:2:7"
    assert [name for name, _ in tree.files] == [str(main), f"{tmp_path}/base.conf", f"{tmp_path}/last.conf"]


def test_include_is_relative_to_the_including_file(tmp_path):
    (tmp_path / "inner").mkdir()
    write(tmp_path / "inner", a='@include "b.conf"', b="x = 1;")
    assert load(write(tmp_path, main='g = { @include "inner/a.conf"\n };')).data == {"g": {"x": 1}}


@pytest.mark.parametrize(
    "include, message",
    [
        ("main.conf", "circular @include"),
        ("loop.conf", "circular @include"),
        ("/etc/passwd", "an @include is relative"),
        ("../" * 40 + "etc/passwd", "leads to the root of the file system"),
        ("../.secret.conf", "into something hidden"),
        ("../.ssh/config", "into something hidden"),
        ("link.conf", "into something hidden"),
        ("missing.conf", "No such file"),
        ("pipe.conf", "not a regular file"),
        (".", "not a regular file|Is a directory"),
        ("deep1.conf", "nested deeper than 4"),
        ("large.conf", "larger than 1 MiB"),
    ],
)
def test_includes_that_are_refused(tmp_path, include, message):
    folder = tmp_path / "case"
    folder.mkdir()
    write(tmp_path, **{".secret": "x = 1;"})
    deep = {f"deep{i}": f'@include "deep{i + 1}.conf"' for i in range(1, 6)}
    main = write(folder, main=f'a = 1;\n@include "{include}"\n', loop='@include "main.conf"', **deep)
    (folder / "link.conf").symlink_to(tmp_path / ".secret.conf")
    (folder / "large.conf").write_text("# " + "x" * (1 << 20))
    os.mkfifo(folder / "pipe.conf")
    faults = load(main).faults
    assert len(faults) == 1 and any(part in faults[0] for part in message.split("|")), faults
    if "deep" not in include and "loop" not in include:
        assert faults[0].startswith(f"{main}:2:1: ")


def test_includes_may_go_up_and_are_looked_for_in_the_working_directory_last(tmp_path, monkeypatch):
    (tmp_path / "conf" / "2d").mkdir(parents=True)
    write(tmp_path / "conf", shared="x = 1;", here="y = 1;")
    main = write(tmp_path / "conf" / "2d", main='@include "../shared.conf"\n@include "conf/here.conf"\n')
    assert "No such file" in load(main).faults[0]
    monkeypatch.chdir(tmp_path)
    tree = load(main)
    assert tree.faults == [] and tree.data == {"x": 1, "y": 1}
    (warning,) = tree.warnings
    assert f"{main}:2:1: 'conf/here.conf' is found in the working directory only; '../here.conf' is" in warning
    (tmp_path / "conf" / "2d" / "conf").mkdir()
    write(tmp_path / "conf" / "2d" / "conf", here="y = 2;")
    assert load(main).data == {"x": 1, "y": 2} and load(main).warnings == []


def test_files_above_the_case_are_kept_with_the_run(tmp_path):
    from hpcpic.core.files.given import contents

    (tmp_path / "2d").mkdir()
    write(tmp_path, shared="x = 1;")
    main = write(tmp_path / "2d", main='@include "../shared.conf"\n@include "a..b.conf"', **{"a..b": "y = 1;"})
    assert list(contents(load(main))) == ["main.conf", "_up/shared.conf", "a..b.conf"]


SECRET = "hunter2hunter2"


@pytest.mark.parametrize(
    "content",
    [
        f"root:{SECRET}:0:0:root:/root:/bin/sh\n",
        f"PORT = 8080\nPASSWORD = {SECRET}\n",
        f"-----BEGIN KEY-----\n{SECRET}\n",
        f"\x89HDF\r\n\x1a\n{SECRET}",
        f'"open {SECRET}',
        f"a = 1; a = 2; {SECRET}",
        f"{SECRET} = 1 {SECRET} = 1e999",
    ],
)
def test_what_is_no_case_is_not_quoted(tmp_path, content):
    other = tmp_path / "other.conf"
    other.write_bytes(content.encode("latin-1"))
    with pytest.raises(ConfigError) as caught:
        load(other)
    main = write(tmp_path, main='simulation = { a = 1; };\n@include "other.conf"\n')
    with pytest.raises(ConfigError) as included:
        load(main)
    for messages in (caught.value.messages, included.value.messages):
        assert len(messages) == 1 and SECRET not in str(messages)
    assert caught.value.messages[0].startswith(f"{other}:")


def test_what_is_wrong_in_a_case_is_quoted(tmp_path):
    with pytest.raises(ConfigError, match="2:5: '5ns' is not a number"):
        load(write(tmp_path, main="simulation = { a = 1; };\nb = 5ns;"))


def test_a_million_forbidden_characters_are_one_fault():
    with pytest.raises(ConfigError) as caught:
        loads("a = 1;\n" + "\x01" * 1_000_000)
    assert caught.value.messages == ["case:2:1: forbidden character U+0001"]


def test_reading_costs_what_the_text_is_long(tmp_path):
    """Files that replace each other's settings: comparisons of paths with paths were quadratic."""
    from time import process_time

    def seconds(n):
        text = "".join(f"k{i} = [1];\n" for i in range(n))
        main = write(tmp_path, main='@include "base.conf"\n' + text, base=text)
        start = process_time()
        load(main)
        return process_time() - start

    seconds(10)
    assert seconds(4000) < 30 * seconds(500)


def test_no_more_than_sixteen_files(tmp_path):
    files = {f"f{i}": f"x{i} = 1;" for i in range(20)}
    faults = load(write(tmp_path, main="\n".join(f'@include "f{i}.conf"' for i in range(20)), **files)).faults
    assert len(faults) == 5 and "more than 16 files" in faults[0]


def test_byte_order_mark_and_carriage_returns_are_read(tmp_path):
    path = tmp_path / "main.conf"
    path.write_bytes(b"\xef\xbb\xbfa = 1;\r\nb = 2;\r\n")
    tree = load(path)
    assert tree.data == {"a": 1, "b": 2} and str(tree.where(("b",))) == f"{path}:2:1"


def test_bytes_that_are_not_utf8_are_refused_with_their_place(tmp_path):
    path = tmp_path / "main.conf"
    path.write_bytes(b"a = 1;\nb = \xff;\n")
    with pytest.raises(ConfigError, match=":2:5: not UTF-8"):
        load(path)


@pytest.mark.parametrize("name", ["missing.conf", ".", "\0"])
def test_a_main_file_that_cannot_be_read(tmp_path, name):
    with pytest.raises(ConfigError, match="cannot read"):
        load(os.path.join(tmp_path, name))


def test_set_overrides_by_path_with_the_same_grammar():
    sets = [
        "a=4",
        "species[0].particles=0x10",
        'species[1].name="x y"',
        "v[1]=7",
        "new.group.key=[1, 2]",
        "b=TSC",
    ]
    tree = loads('a = 1; species = ({ particles = 1 }, { name = "e" }); v = [1, 2];', sets=sets)
    assert tree.faults == []
    assert tree.data == {
        "a": 4,
        "species": ({"particles": 16}, {"name": "x y"}),
        "v": [1, 7],
        "new": {"group": {"key": [1, 2]}},
        "b": "TSC",
    }
    assert str(tree.where(("species", 0, "particles"))) == "--set species[0].particles=0x10"
    assert tree.sets == tuple(sets)


@pytest.mark.parametrize(
    ("whole", "parts"),
    [
        ("a={ x = 5; }", ["a.x=5"]),
        ("a={ g = { z = 7; }; new = { k = 1; }; }", ["a.g.z=7", "a.new.k=1"]),
        ("s[0]={ x = 2; v = [3]; }", ["s[0].x=2", "s[0].v=[3]"]),
        ("a={ }", []),
    ],
)
def test_a_group_that_is_set_merges_as_its_keys_set_one_by_one(whole, parts):
    text = "a = { x = 1; y = [1, 2]; g = { z = 3; w = 4; }; }; s = ({ x = 1; y = 2; });"
    tree, other = loads(text, sets=[whole]), loads(text, sets=parts)
    assert tree.faults == other.faults == [] and tree.data == other.data
    assert tree.where(("a", "y")) == other.where(("a", "y")) and tree.where(("a", "y")).line == 1


def test_a_list_that_is_set_takes_the_place_of_the_list():
    tree = loads("s = ({ x = 1; }, { y = 2; }); v = [1, 2];", sets=["s=({ z = 3; })", "v=[7]"])
    assert tree.data == {"s": ({"z": 3},), "v": [7]}


@pytest.mark.parametrize(
    "assignment",
    [
        "a",
        "=1",
        "a=",
        "a=1 b=2",
        "a=1;b=2",
        "a=[1,",
        "v[2]=1",
        "species[1].x=1",
        "species[0]=1",
        "species[1]={ x = 1; }",
        "v[0]={ x = 1",
        "a.b=1",
        "a..b=1",
        "a=1e999",
        "v[-1]=1",
        "species.x=1",
        "none[0].x=1",
    ],
)
def test_set_faults_are_told_with_the_assignment(assignment):
    tree = loads("a = 1; v = [1, 2]; species = ({ x = 1; });", sets=[assignment])
    assert len(tree.faults) == 1 and tree.faults[0].startswith(f"--set {assignment}: ")
    assert tree.data == {"a": 1, "v": [1, 2], "species": ({"x": 1},)}


@pytest.mark.parametrize("assignment, example", [
    ("s[0].axis=y+", "--set 's[0].axis=\"y+\"'"),
    ("a=my file.npz", "--set 'a=\"my file.npz\"'"),
    ("v=[x, y]", "--set 'key=[\"text\"]'"),
    ('v=["x", y]', None),
    ("a=[1, 2", None),
])  # fmt: skip
def test_a_text_without_quotes_is_told_how_a_shell_leaves_them(assignment, example):
    fault = loads("a = 1; v = []; s = ({ x = 1; });", sets=[assignment]).faults[0]
    assert fault.endswith(f"texts stand in quotes, within those of the shell: {example}") == (example is not None)


def test_values_parse_as_in_a_file():
    assert parse_value("[1, 2.0]") == [1, 2.0]
    assert parse_value("True") is True and parse_value("CIC") == "CIC" and parse_value('"a b"') == "a b"
    assert parse_value("hull.v2.stl") == "hull.v2.stl"
    for text in ("", "1 2", "1; x = 2", "}", "{", "hull.", "a..b"):
        with pytest.raises(ConfigError):
            parse_value(text)


marks = '=:;,{}()[]"\\#-\n\r\t\0 \ufeff\u202e'
words = [
    "a",
    "b.c",
    "@include",
    "/*",
    "*/",
    "//",
    "1",
    ".5",
    "1e9",
    "1e999",
    "0x",
    "9" * 30,
    "true",
    "é",
    "L",
]
fragments = st.sampled_from([*marks, *words])


@settings(max_examples=300)
@given(st.one_of(st.text(max_size=60), st.lists(fragments, max_size=30).map("".join)))
def test_no_text_breaks_the_reader(text):
    try:
        tree = loads(text)
    except ConfigError as error:
        assert error.messages and all(message.startswith("case:") for message in error.messages)
    else:
        assert isinstance(tree.data, dict)


@settings(max_examples=100)
@given(st.binary(max_size=80))
def test_no_bytes_break_the_reader(content):
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "main.conf")
        with open(path, "wb") as file:
            file.write(content)
        try:
            load(path)
        except ConfigError as error:
            assert error.exit_code == 2


@given(st.text(max_size=40))
def test_no_set_breaks_the_reader(text):
    try:
        loads("a = 1; v = [1, 2]; s = ({ x = 1; });", sets=[text])
    except ConfigError:
        pytest.fail("a fault of --set belongs into the list of faults")


def test_the_grammar_is_read_only_when_a_file_is():
    import subprocess
    import sys

    code = "import sys; import hpcpic.core.case.config; print('lark' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"
    assert config.MAX_BYTES == 2**20


def test_leaves_are_the_settings_with_their_keys():
    tree = loads("a = { b = [1, 2]; c = ( { d = 1; }, 5 ); };")
    assert dict(leaves(tree.data)) == {"a.b": [1, 2], "a.c[0].d": 1, "a.c[1]": 5}
