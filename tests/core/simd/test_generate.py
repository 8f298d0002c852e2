"""Kernels that are made for a scene, from files that are their own templates."""

import math

import pytest

from hpcpic.core.simd.generate import specialise

BASE = "DIM = 2\nSIZE = 10**DIM\n\n\ndef corners():\n    return 2**DIM\n"
LINE = "from written.base import corners\n\nREACH = 1\nWIDTH = 8\n\n\ndef nodes():\n    return corners() * REACH\n"
PARABOLA = "from written.base import SIZE\n\nWIDTH = 27 * SIZE\n\n\ndef nodes():\n    return WIDTH\n"
PUSH = (
    "from written.base import (\n    SIZE,\n    corners,\n)\nfrom written.line import WIDTH, nodes\n\nTURNS = 0\n\n\n"
    "def push():\n    return nodes(), WIDTH, TURNS, SIZE, corners()\n"
)

APART = """from typing import NamedTuple
import math
PLACES = []
PLACES.append(math.pi)
TURNS, TURNED = 0, 5
WIDE = 8


class Pair(NamedTuple):
    first: int


def still():
    return Pair(WIDE)


def turning(WIDE):
    def inner():
        return TURNED + WIDE
    return Pair(inner() * TURNS)


def told():
    return PLACES, still().first
"""


@pytest.fixture
def written(tmp_path, monkeypatch):
    folder = tmp_path / "written"
    folder.mkdir()
    files = {"__init__": "", "base": BASE, "line": LINE, "parabola": PARABOLA, "push": PUSH, "apart": APART}
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return folder


def modules_of(made, *names):
    return [getattr(made, name).__module__ for name in names]


def test_scenes_share_what_does_not_depend_on_the_constants_in_which_they_differ(written):
    def made(**constants):
        return specialise("written", ["base", "line", "push"], DIM=3, **constants)

    one, turning, far = made(TURNS=0), made(TURNS=2), made(REACH=2)
    assert (one.push(), turning.push(), far.push()) == ((8, 8, 0, 1000, 8), (8, 8, 2, 1000, 8), (16, 8, 0, 1000, 8))
    of_one, of_turning, of_far = (modules_of(scene, "corners", "nodes", "push") for scene in (one, turning, far))
    assert of_turning[:2] == of_one[:2] and of_turning[2] != of_one[2]
    assert of_far[0] == of_one[0] and not {*of_far[1:]} & {*of_one}  # push calls nodes
    assert specialise("written", ["base"]).corners() == 4


def test_definitions_of_a_file_share_what_does_not_read_the_constants_in_which_they_differ(written):
    """A name that a function gives to something of its own is none of the file's; a class is one for all."""
    one, wide = specialise("written", ["apart"], WIDE=8), specialise("written", ["apart"], WIDE=16)
    assert (one.still(), wide.still(), one.turning(1), wide.told()) == ((8,), (16,), (0,), ([math.pi], 16))
    of_one, of_wide = (modules_of(scene, "Pair", "turning", "still", "told") for scene in (one, wide))
    assert of_wide[:2] == of_one[:2] and not {*of_wide[2:]} & {*of_one}
    assert type(one.still()) is type(wide.turning(0)) is one.Pair and wide.TURNED == 5
    with pytest.raises(AttributeError, match="have no spin"):
        _ = one.spin


def test_a_file_may_stand_in_the_place_of_another_and_a_later_name_of_an_earlier(written):
    other = specialise("written", ["base", "parabola", "push"], replaced=("line",))
    assert other.push() == (2700, 2700, 0, 100, 4)
    more = specialise("written", ["base", "line", "push"], {"line": "\n\ndef nodes():\n    return 5\n"})
    assert more.push()[0] == more.nodes() == 5
    both = specialise("written", ["base", "line", "parabola", "push"])
    assert both.nodes() == 2700 and both.push()[:2] == (2700, 2700)


def test_an_unknown_constant_is_told(written):
    with pytest.raises(KeyError, match="push have no constant SPEED"):
        specialise("written", ["base", "line", "push"], SPEED=1)
