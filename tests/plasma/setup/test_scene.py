"""The initial state: pure functions of case and id with the moments, symmetries and units that are asked."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpcpic.core.case.config import load, loads
from hpcpic.plasma.app import shipped_cases
from hpcpic.plasma.case.config import rotation
from hpcpic.plasma.configure import configure
from hpcpic.plasma.diagnostics.kept_motion import laws
from hpcpic.plasma.physics.boris import boris, turn
from hpcpic.plasma.physics.quiet_start import BASES, lattice, radical_inverse
from hpcpic.plasma.setup.loaders import velocity_moments
from hpcpic.plasma.setup.scene import Scene

CASE = """
simulation = { cycles = 10; time_step = 0.1; space_length = [8.0, 4.0]; random_seed = 7; };
grid = { points = [16, 8]; };
species = (
  { name = "first"; particles = 1000; charge = -2.0; mass = 4.0; drift_velocity = [1.0, -3.0]; },
  { name = "second"; particles = 4096; charge = 1.0; mass = 2.0; drift_velocity = [0.5, 0.25]; }
);
"""


def scene_of(*sets, text=CASE):
    return Scene(configure(loads(text, sets=sets)))


def second(*sets, text=CASE):
    """The second species with settings of its own."""
    return scene_of(*(f"species[1].{assignment}" for assignment in sets), text=text).species[1]


def state(species):
    ids = np.array(species.ids)
    return species.positions(ids), species.velocities(ids)


METHODS = [
    ('init_method="random position"',),
    ('init_method="random position"', "thermal_velocity=0.5"),
    ("init_method=default",),
    ("init_method=default", "thermal_velocity=0.5"),
    ("init_method=quiet",),
    ("init_method=quiet", "thermal_velocity=0.5"),
    (
        'init_method="position delta"',
        "position_init=[7.5, 1]",
        "position_delta=[0.3, -0.7]",
        "thermal_velocity=0.5",
    ),
    ('init_method="harmonic two electrons"', "particles=2"),
]
WAVE = "perturbation={mode=[1, -2]; amplitude=0.2; velocity_amplitude=0.3}"


@pytest.mark.parametrize("sets", METHODS)
def test_the_state_of_an_id_does_not_depend_on_who_asks(sets):
    species = second(*sets, WAVE)
    ids = np.array(species.ids)
    x, v = state(species)
    order = np.random.default_rng(0).permutation(len(ids))
    parts = [order[:1], order[1:7], order[7:]]
    for part in parts:
        np.testing.assert_array_equal(species.positions(ids[part]), x[part])
        np.testing.assert_array_equal(species.velocities(ids[part]), v[part])


@pytest.mark.parametrize("sets", METHODS)
def test_positions_are_in_the_box_and_finite(sets):
    x, v = state(second(*sets, WAVE))
    assert x.shape[1] == 2 and v.shape == x.shape
    assert (x >= 0).all() and (x < [8.0, 4.0]).all() and np.isfinite(v).all()


@pytest.mark.parametrize("frequency", [0.0, 3.0])
@pytest.mark.parametrize("sets", METHODS)
def test_rescaled_units_give_the_same_bits_inside_the_step(sets, frequency):
    second_, metre, coulomb, kilogram = 2.0**11, 2.0**-20, 2.0**7, 2.0**-3  # one old unit in new ones
    speed = metre / second_
    sets = tuple(f"species[1].{assignment}" for assignment in (*sets, f"plasma_frequency={frequency}"))

    def normalised(*scaled):
        scene = scene_of(*sets, *scaled)
        species = scene.species[1]
        x, v = state(species)
        dx = np.array(scene.spacing)
        field = species.q / (scene.permittivity * dx[0])  # V/m between neighbours
        return x / dx, v * scene.time_step / dx, species.half_kick * field, scene.mover(1.0)[1, 4:]

    section = scene_of(*sets).species[1].section
    scaled = [
        f"simulation.time_step={0.1 * second_!r}",
        f"simulation.space_length=[{8 * metre!r}, {4 * metre!r}]",
        f"constants.vacuum_permittivity={(coulomb * second_ / metre) ** 2 / kilogram!r}",
        f"field.magnetic=[0, 0, {kilogram / (coulomb * second_)!r}]",
        f"species[1].charge={coulomb!r}",
        f"species[1].mass={2 * kilogram!r}",
        f"species[1].drift_velocity=[{0.5 * speed!r}, {0.25 * speed!r}]",
        f"species[1].thermal_velocity={section.thermal_velocity * speed!r}",
        f"species[1].plasma_frequency={frequency / second_!r}",
        f"species[1].position_init={[value * metre for value in section.position_init]!r}",
        f"species[1].position_delta={[value * metre for value in section.position_delta]!r}",
    ]
    for original, other in zip(normalised("field.magnetic=[0, 0, 1]"), normalised(*scaled)):
        np.testing.assert_array_equal(original, other)


def test_ids_are_global_and_species_follow_each_other():
    scene = scene_of()
    assert [species.ids for species in scene.species] == [range(0, 1000), range(1000, 5096)]
    assert scene.n_particles == 5096


def test_species_do_not_share_random_numbers():
    scene = scene_of('species[0].init_method="random position"', 'species[1].init_method="random position"')
    first, other = state(scene.species[0])[0], state(scene.species[1])[0]
    assert not np.isin(first, other).any()


def test_the_background_makes_the_box_neutral():
    scene = scene_of()
    charge = sum(species.q * species.n for species in scene.species)
    assert scene.background * scene.volume + charge == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("charge", [-2.0, 3e-19])
def test_the_plasma_frequency_sets_the_macro_charge(charge):
    species = second(f"charge={charge}", "plasma_frequency=3.0")
    scene = species.scene
    density = species.n / scene.volume
    assert density * species.q**2 / (species.m * scene.permittivity) == pytest.approx(9.0, rel=1e-14)
    assert species.q / species.m == pytest.approx(charge / 2.0, rel=1e-15)


def test_without_a_plasma_frequency_charge_and_mass_are_as_given():
    species = second()
    assert (species.q, species.m) == (1.0, 2.0)


def test_random_positions_of_the_thesis_have_velocities_uniform_within_the_drift():
    x, v = state(second('init_method="random position"', "particles=100000"))
    np.testing.assert_array_equal(v, state(second('init_method="uniform velocities"', "particles=100000"))[1])
    bound = np.array([0.5, 0.25])
    assert (abs(v) < bound).all()
    # mean and variance of 1e5 numbers: 5 standard errors
    assert (abs(v.mean(0)) < 5 * bound / np.sqrt(3e5)).all()
    np.testing.assert_allclose(v.std(0), bound / np.sqrt(3), rtol=0.01)
    np.testing.assert_allclose(x.mean(0), [4.0, 2.0], atol=0.05)


def test_a_thermal_velocity_adds_normal_deviates_to_the_drift():
    for method in ("random position", "position delta", "quiet"):
        sets = (f'init_method="{method}"', "particles=100000", "thermal_velocity=0.5")
        _, v = state(second(*sets, "position_init=[0, 0]", "position_delta=[0, 0]"))
        np.testing.assert_allclose(v.mean(0), [0.5, 0.25], atol=5 * 0.5 / np.sqrt(1e5))
        np.testing.assert_allclose(v.std(0), 0.5, rtol=0.012)
        np.testing.assert_allclose(((v - v.mean(0)) ** 4).mean(0), 3 * 0.5**4, rtol=0.08)


@pytest.mark.parametrize("word", ["default", '"opposite beams"'])
def test_two_opposite_beams_are_made_where_they_are_asked_for(word):
    _, v = state(second(f"init_method={word}"))
    np.testing.assert_array_equal(v[1::2], np.tile([0.5, 0.25], (2048, 1)))
    np.testing.assert_array_equal(v[::2], -v[1::2])


def test_harmonic_two_electrons_stand_at_three_and_five_eighths():
    x, v = state(second('init_method="harmonic two electrons"', "particles=2"))
    np.testing.assert_array_equal(x, [[3.0, 2.0], [5.0, 2.0]])
    np.testing.assert_array_equal(v, [[0.5, 0.0], [-0.5, 0.0]])


def test_a_drift_without_a_method_is_a_drift():
    for thermal in (0.0, 0.5):
        sets = ("particles=100000", f"thermal_velocity={thermal}")
        _, v = state(second("init_method=random", *sets))
        np.testing.assert_allclose(v.mean(0), [0.5, 0.25], atol=5 * thermal / np.sqrt(1e5) + 1e-15)
        text = CASE.replace('init_method = "quiet";', "")
        assert "init_method" not in text
        np.testing.assert_array_equal(v, state(second(*sets, text=text))[1])


@pytest.mark.parametrize("sets", METHODS)
def test_mean_and_spread_are_those_of_the_particles(sets):
    species = second(*(sets if "particles=2" in sets[-1] else (*sets, "particles=100000")))
    for waved in (species, second(*sets, "particles=100000", WAVE)) if species.n > 2 else (species,):
        _, v = state(waved)
        for axis in range(v.shape[1]):
            mean, spread = velocity_moments(waved.scene.config, waved.section, axis)
            error = 5 * max(spread, 1e-15) / np.sqrt(waved.n)
            assert v[:, axis].mean() == pytest.approx(mean, abs=error)
            assert v[:, axis].std() == pytest.approx(spread, abs=error)


def test_position_delta_walks_through_the_periodic_box():
    species = second('init_method="position delta"', "position_init=[7.5, 0.5]", "position_delta=[1.0, -0.5]")
    x, v = state(species)
    np.testing.assert_allclose(x[:3], [[7.5, 0.5], [0.5, 0.0], [1.5, 3.5]], atol=1e-15)
    assert (v == [0.5, 0.25]).all()


def test_a_quiet_start_is_far_more_even_than_a_random_one():
    def roughness(*sets):
        x, v = state(second("particles=65536", "thermal_velocity=1.0", *sets))
        density = [abs(np.exp(-2j * np.pi * (m * x[:, 0] / 8 + n * x[:, 1] / 4)).mean()) for m, n in MODES]
        return max(density), abs(v.mean(0) - [0.5, 0.25]).max(), abs(v.std(0) - 1).max()

    MODES = [(1, 0), (0, 1), (2, 0), (1, 1), (3, -2)]
    quiet, noisy = roughness("init_method=quiet"), roughness('init_method="random position"')
    assert all(q < 0.1 * r for q, r in zip(quiet, noisy))
    assert quiet[0] < 1e-4


def test_a_quiet_start_is_even_in_phase_space():
    """Position and velocity are uncorrelated: currents and temperatures of the first modes vanish."""
    text = CASE.replace("[8.0, 4.0]", "8.0").replace("[16, 8]", "16").replace(", -3.0]", "]").replace(", 0.25]", "]")
    x, v = state(second("particles=65536", "thermal_velocity=1.0", "init_method=quiet", text=text))
    for m in (1, 2, 3):
        wave = np.exp(-2j * np.pi * m * x[:, 0] / 8)
        assert abs((wave * v[:, 0]).mean()) < 3e-4 and abs((wave * v[:, 0] ** 2).mean()) < 2e-3


def test_a_cold_quiet_start_is_a_lattice_with_whole_numbers_per_cell():
    species = second("init_method=quiet", "particles=2048")  # 4 x 4 in each of 16 x 8 cells
    x, _ = state(species)
    cells = np.floor(x / np.array(species.scene.spacing)).astype(int)
    counts = np.bincount(cells[:, 0] + 16 * cells[:, 1], minlength=128)
    assert (counts == 16).all()


def test_a_perturbation_moves_positions_and_velocities_along_k():
    plain, waved = second("init_method=quiet"), second("init_method=quiet", WAVE)
    (x0, v0), (x, v) = state(plain), state(waved)
    k = 2 * np.pi * np.array([1 / 8, -2 / 4])
    sine = np.sin(x0 @ k)[:, None]
    moved = (x - x0 + [4.0, 2.0]) % [8.0, 4.0] - [4.0, 2.0]
    np.testing.assert_allclose(moved, 0.2 * sine * k / (k @ k), atol=1e-14)
    np.testing.assert_allclose(v - v0, 0.3 * sine * k / np.sqrt(k @ k), atol=1e-14)


def test_a_perturbation_makes_a_density_wave_of_its_amplitude():
    text = CASE.replace("[8.0, 4.0]", "8.0").replace("[16, 8]", "16").replace(", -3.0]", "]").replace(", 0.25]", "]")
    x, _ = state(second("init_method=quiet", "perturbation={mode=3; amplitude=0.01}", text=text))
    wave = np.exp(-2j * np.pi * 3 * x[:, 0] / 8).mean()
    assert wave == pytest.approx(-0.005, rel=1e-3)  # n = n0 (1 - a cos kx) to first order in a


@pytest.mark.parametrize("exact", ["true", "false"])
@given(st.tuples(*(st.floats(-30, 30) for _ in range(3))))
def test_the_rotation_keeps_the_speed_and_turns_by_the_right_angle(exact, magnetic):
    sets = (f"field.magnetic={list(magnetic)}", f"numerics.exact_phase={exact}", "field.electric=[0, 0, 1]")
    species = scene_of(*sets).species[0]
    rotation = np.eye(3) + turn(*species.rotation)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=4e-16 * 8)
    w = 0.5 * np.sqrt(np.dot(magnetic, magnetic)) * 0.1  # |q/m| B dt
    angle = w if exact == "true" else 2 * np.arctan(w / 2)
    assert np.trace(rotation) == pytest.approx(1 + 2 * np.cos(angle), abs=1e-13)


def test_the_rotation_is_the_cross_product_of_boris():
    species = scene_of("field.magnetic=[1.0, -2.0, 3.0]").species[0]
    t, s = species.rotation
    v = np.array([0.3, -0.5, 0.7])
    np.testing.assert_allclose(v + turn(t, s) @ v, v + np.cross(v + np.cross(v, t), s), rtol=1e-14)


@pytest.mark.parametrize("steps", [1.0, -0.5])
@pytest.mark.parametrize("text, d", [(CASE, 2), (CASE.replace("[8.0, 4.0]", "8.0").replace("[16, 8]", "[16]"), 1)])
@pytest.mark.parametrize("magnetic", [(0.0, 0.0, 30.0), (18.0, 0.0, 24.0), (-9.0, 12.0, 7.0), (3.0, 0.0, 0.0)])
def test_an_exact_phase_drifts_by_e_over_b_and_falls_along_b_as_without_a_field(magnetic, text, d, steps):
    """The electric impulse and one's own acceleration alike, in a step and in the half step backwards of the start."""
    electric = np.array([0.3, -0.2, 0.5])
    sets = (f"field.magnetic={list(magnetic)}", f"field.electric={electric.tolist()}", "numerics.exact_phase=true")
    scene = scene_of(*sets, text=text)
    b = np.array(magnetic)
    drift, along = np.cross(electric, b) / (b @ b), (electric @ b) * b / (b @ b)
    side = np.array((*scene.spacing, scene.spacing[0], scene.spacing[0])[:3]) / scene.time_step
    numbers, species = scene.mover(1.0, steps)[0], scene.species[0]
    kind, before, e = rotation(scene.config), drift / side, electric.copy()
    after = np.array(boris(*before, *e, numbers, d, kind)) * side
    fallen = steps * scene.time_step * species.charge_to_mass * along
    np.testing.assert_allclose(after - fallen, drift, rtol=0, atol=1e-13)
    numbers[:4], numbers[10:13] = 0.0, 0.0  # the turn alone, after the same acceleration as one's own
    own = (drift + species.before_turn(steps) @ electric * species.charge_to_mass * scene.time_step) / side
    np.testing.assert_allclose(np.array(boris(*own, *e, numbers, d, kind)) * side - fallen, drift, rtol=0, atol=1e-13)


def test_forces_across_b_add_up_to_nothing_only_where_impulses_are_multiplied_alike():
    x, y, z = np.eye(3).tolist()
    sets = ("field.magnetic=[0, 0, 6]", "numerics.exact_phase=true")
    for more, kept in (((), [x, y, z]), (("species[1].mass=20",), [z])):  # |q/m| is 0.5 of both, or not
        assert [law.along.tolist() for law in laws(scene_of(*sets, *more))] == kept


@pytest.mark.parametrize("electric, exact, kept", [
    ([1, 0, 0], "false", [[0, 0, 1]]), ([1, 0, 0], "true", []),
    ([0, 1, 0], "true", [[1, 0, 0], [0, 0, 1], [0.6, 0, 0.8]]),
])  # fmt: skip
def test_a_field_oblique_to_b_pushes_along_other_axes_too_with_an_exact_phase(electric, exact, kept):
    """Its impulse is f E + (1 - f) (E.b) b, b = B/|B|: along z too where E lies along x and B between these."""
    scene = scene_of("field.magnetic=[6, 0, 8]", f"field.electric={electric}", f"numerics.exact_phase={exact}")
    assert [law.along.tolist() for law in laws(scene)] == kept


def test_half_kick_turns_volts_per_metre_into_cells_per_step():
    species = scene_of().species[0]
    # dv = (q/m) E dt/2, in cells per step: times dt/dx
    expected = -0.5 * 0.1 / 2 * 0.1 / np.array(species.scene.spacing)
    np.testing.assert_allclose(species.half_kick, expected, rtol=1e-15)


@pytest.mark.parametrize("name", shipped_cases())
def test_every_shipped_case_makes_a_scene(name):
    scene = Scene(configure(load(shipped_cases()[name])))
    for species in scene.species:
        ids = np.array(species.ids[:: max(1, species.n // 100)])
        assert np.isfinite(species.positions(ids)).all() and np.isfinite(species.velocities(ids)).all()


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("total", [1, 2, 7, 64, 343, 1000])
def test_radical_inverses_are_distinct_and_evenly_spread(base, total):
    u = radical_inverse(np.arange(total), base, total)
    assert ((u > 0) & (u < 1)).all() and len(np.unique(u)) == total
    digits = int(np.ceil(np.log(total) / np.log(base) - 1e-9))
    counts = np.histogram(u, bins=base ** max(digits - 1, 0), range=(0, 1))[0]
    assert counts.max() - counts.min() <= base - 1 or total < base


def test_bit_reversed_numbers_in_base_two():
    np.testing.assert_array_equal(radical_inverse(np.arange(8), 2, 8) * 8, [0.5, 4.5, 2.5, 6.5, 1.5, 5.5, 3.5, 7.5])


@given(st.integers(1, 5000), st.integers(1, 64), st.integers(1, 64))
def test_a_lattice_has_all_points_and_the_proportions_of_the_grid(total, columns, rows):
    found = lattice(total, (columns, rows))
    if found:
        assert found[0] * found[1] == total
        assert 1 / 4 <= found[0] / found[1] / (columns / rows) <= 4


def test_a_lattice_prefers_whole_numbers_per_cell():
    assert lattice(512 * 512, (128, 128)) == (512, 512)
    assert lattice(16 * 8 * 2, (16, 8)) in ((32, 8), (16, 16))
    assert lattice(1009, (16, 16)) is None
