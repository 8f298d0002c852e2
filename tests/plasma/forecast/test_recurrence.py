"""The time of recurrence that `check` tells, beside runs of one species and of two."""

import math

import numpy as np
import pytest

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived
from hpcpic.plasma.forecast.recurrence import waves_of
from hpcpic.plasma.physics.dispersion import Beam, root_near, susceptibility
from hpcpic.plasma.physics.quiet_start import recurrence_time
from hpcpic.plasma.step import Plasma

HALF = math.sqrt(0.5)  # wp of half of the electrons


def species(name, n, wp, thermal, amplitude=None, mass=1.0, method="strata", mode="[1]"):
    wave = f"perturbation = {{ mode = {mode}; amplitude = {amplitude}; }};" if amplitude is not None else ""
    places = "places = 8;" if method == "strata" else ""
    return f"""{{ name = "{name}"; particles = {n}; charge = -1.0; mass = {mass!r}; plasma_frequency = {wp!r};
        thermal_velocity = {thermal!r}; init_method = "{method}"; {places} {wave} }}"""


def config_of(k, *of_species, time=200.0, dt=0.2, scale=1.0, head=""):
    length, cycles = scale * 2 * math.pi / k, round(time / dt)
    return configure(
        loads(f"""
        simulation = {{ cycles = {cycles}; time_step = {dt!r}; space_length = [{length!r}]; }};
        grid = {{ points = [64]; }}; {head} species = ( {", ".join(of_species)} );""")
    )


def told(config):
    """The time of each species that `check` tells of."""
    return {line.name.split()[-1]: line for line in derived(config) if line.symbol == "2 pi/(k dv)"}


def two(hot, cool, first=None, cooler=0.07, method="strata"):
    return species("hot", hot, HALF, 1.0, first, method=method), species("cool", cool, HALF, cooler, 1e-3)


def turning(config, period):
    """The half period in which the first mode is least."""
    plasma, wave = Plasma(config, World.start(), Pool(1), Timers()), []
    for _ in range(config.simulation.cycles):
        plasma.solve()
        wave.append(np.abs(np.fft.rfft(plasma.mesh.e[0][plasma.mesh.inside])[1]))
        plasma.step()
    plasma.close()
    steps = round(period / 2 / config.simulation.time_step)
    largest = [max(wave[i : i + steps]) for i in range(0, len(wave) - steps, steps)]
    return (np.argmin(largest) + 0.5) * period / 2


@pytest.mark.parametrize(
    ("k", "of_species", "name", "expected"),
    [
        (0.4, (species("e", 4096, 1.0, 1.0, 1e-3),), "e", 18.4),
        (0.4, (species("e", 8192, 1.0, 1.0, 1e-3),), "e", 36.8),
        (0.314, two(16384, 4096), "hot", 31.7),
        (0.314, two(32768, 4096), "hot", 63.5),
        (0.314, two(32768, 4096, first=1e-3), "hot", 63.5),
    ],
)
def test_a_mode_turns_to_grow_when_check_says_so(k, of_species, name, expected):
    """It is damped until about the told time (0.55 to 1.2 of it here): the hot ones damp it whichever are displaced."""
    ((found, line),) = told(config_of(k, *of_species)).items()
    assert found == name and line.verdict == "warn" and line.value == pytest.approx(expected, rel=0.01)
    measured = turning(config_of(k, *of_species, time=1.5 * line.value), 2 * math.pi / math.hypot(1.0, 1.6 * k))
    assert 0.5 < measured / line.value < 1.3


def test_the_wave_is_that_of_all_species_together():
    """The root of both: 2.84 thermal velocities by the hot ones alone would make it nine times as long."""
    k = 2 * math.pi / 20
    beams = (Beam(HALF, 0.0, 1.0), Beam(HALF, 0.0, 0.07))
    root = root_near(1.11 - 0.02j, lambda w: 1.0 - susceptibility(w, k, beams))
    assert root == pytest.approx(1.1098 - 0.0193j, abs=1e-4)
    for first in (None, 1e-3):
        line = told(config_of(k, *two(131072, 131072, first)))["hot"]
        assert line.value == pytest.approx(recurrence_time(131072 // 8, k, 1.0, root.real / k), rel=0.01)  # the mesh's


def test_halves_of_a_species_are_told_what_all_of_it_is():
    one = told(config_of(0.35, species("e", 8192, 1.0, 1.0, 1e-3)))["e"]
    halves = told(config_of(0.35, species("a", 8192, HALF, 1.0, 1e-3), species("b", 8192, HALF, 1.0)))
    assert [line.value for line in halves.values()] == pytest.approx([one.value] * 2, rel=1e-9)


@pytest.mark.parametrize("lengths, times", [(2.0**20, 1.0), (1.0, 2.0**-30), (2.0**-15, 2.0**12)])
def test_other_units_tell_the_same(lengths, times):
    def case(lengths, times):
        pair = (species("hot", 16384, HALF / times, lengths / times), species("cool", 4096, HALF / times,
                0.07 * lengths / times, 1e-3))  # fmt: skip
        return told(config_of(0.314, *pair, time=200 * times, dt=0.2 * times, scale=lengths))["hot"].value

    assert case(lengths, times) == pytest.approx(times * case(1.0, 1.0), rel=1e-12)


def test_the_shortest_time_is_told_once_whoever_is_displaced():
    """Modes 1 and 2: waves of the second are slower, where the hot beams are denser."""
    first, second = species("hot", 16384, HALF, 1.0), species("cool", 4096, HALF, 0.07, 1e-3)
    again = species("hot", 16384, HALF, 1.0, 1e-3, mode="[2]")
    alone = told(config_of(0.25, first, second, time=400.0))["hot"].value
    assert told(config_of(0.25, again, second, time=400.0))["hot"].value == alone
    of_second = told(config_of(0.25, again, species("cool", 4096, HALF, 0.07), time=400.0))["hot"].value
    assert of_second > alone


def test_nothing_is_told_of_what_damps_no_wave():
    assert not told(config_of(0.314, *(species(*s) for s in [("hot", 4096, HALF, 1.0), ("cool", 4096, HALF, 0.07)])))
    assert not told(config_of(0.314, *two(4096, 4096, method="quiet")))  # the cool ones, 50 spreads slower than it
    assert not told(config_of(0.05, species("e", 4096, 1.0, 1.0, 1e-3)))  # 20 thermal velocities
    neutral = species("n", 4096, 1.0, 1.0).replace("charge = -1.0", "charge = 0.0")
    neutral = neutral.replace("plasma_frequency = 1.0;", "")
    assert set(told(config_of(0.314, neutral, *two(4096, 4096)))) == {"hot"}
    attracting = "field = { equation = { a = -1.0; }; };"
    assert not told(config_of(0.314, *two(4096, 4096), head=attracting))


def test_drift_of_all_changes_nothing():
    moved = [text.replace("init_method", "drift_velocity = [0.7]; init_method") for text in two(16384, 4096)]
    still = told(config_of(0.314, *two(16384, 4096)))["hot"].value
    assert told(config_of(0.314, *moved))["hot"].value == pytest.approx(still, rel=1e-9)


def test_beams_far_apart_have_their_own_waves():
    """As though the other were not there: a beam so fast has no part in the waves of the hot ones."""
    hot, beam = two(16384, 4096, first=1e-3)
    fast = beam.replace("init_method", "drift_velocity = [1e4]; init_method")
    alone = told(config_of(0.25, hot))["hot"].value
    assert told(config_of(0.25, hot, fast))["hot"].value == pytest.approx(alone, rel=1e-3)


@pytest.mark.parametrize("thermal", [0.0, 1e-3, 1e-6, 1e-12])
def test_waves_are_those_of_langmuir_and_acoustic_ones_of_cold_ions(thermal):
    """However cool ions are: 1 + 1/k^2 = wi^2/w^2 has the slow one."""
    k, ions = 0.3, 0.02
    slow = ions / math.sqrt(1 + 1 / k**2)
    found = sorted(waves_of([Beam(1.0, 0.0, k), Beam(ions, 0.0, ions * k * thermal)]))
    assert found == pytest.approx([-1.16, -slow, slow, 1.16], rel=2e-3)
