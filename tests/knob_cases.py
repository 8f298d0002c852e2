"""What the tests of the knobs of every program ask of its shipped cases."""

from collections.abc import Callable
from typing import Any

from hpcpic.core.case.config import load


def reader(configure: Callable[..., Any], cases: Callable[[], Any]) -> Callable[..., Any]:
    """read(case, sets=()) -> the completed shipped case."""

    def read(case, sets=()):
        return configure(load(cases()[case], sets))

    return read


def sizes_of(knobs, config):
    return {knob.name: knob.size(config) for knob in knobs.knobs}


def made_again(read, knobs_of, case):
    """The case, and the case with the settings that its own sizes give."""
    config = read(case)
    knobs = knobs_of(config)
    return config, read(case, knobs.settings(sizes_of(knobs, config), knobs.time))
