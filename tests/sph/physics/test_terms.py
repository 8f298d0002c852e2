import numpy as np
import pytest
from seldom import seldom
from sph_scenes import by_id, column, engine, jitter, reference, tank

ROUNDING = 1e-12  # of sums of 100 terms in float64, relative to the largest value
SINGLE = 2e-5  # the same in float32


def check(tolerance, density=5.0, **settings):
    sph = engine(**settings)
    jitter(sph, density=density)
    expected = reference(sph)
    for name, wanted, evaluate in (
        ("a", expected.acceleration(), sph.evolution.evaluate_forces if sph.spec.split else sph.evolution.evaluate),
        ("rate", expected.rate(), sph.evolution.evaluate_rates if sph.spec.split else sph.evolution.evaluate),
    ):
        evaluate()
        assert np.abs(by_id(sph, name)[0] - wanted).max() <= tolerance * np.abs(wanted).max()


def both(*cases):
    """Cases with both sums in one (euler), and one after the other (symplectic). By default with one of them, the first
    of each, or none: kernels of one case take 2 to 7 s to compile.
    """
    return [
        pytest.param(integrator, *case, marks=[] if integrator == chosen else pytest.mark.validation)
        for chosen, *case in cases
        for integrator in ("euler", "symplectic")
    ]


@pytest.mark.parametrize(
    "integrator, d, flux",
    both(
        ("euler", 2, "none"), ("symplectic", 2, "rusanov"), ("symplectic", 2, "molteni"), ("euler", 2, "fourtakas"),
        ("euler", 2, "delta"), ("symplectic", 3, "fourtakas"),
    ),
)  # fmt: skip
def test_sums_are_those_over_all_pairs(integrator, d, flux):
    """In 3D the storage has the axis of gravity first."""
    size = 1.0 if d == 2 else (1.0, 1.0, 1.3)
    check(ROUNDING, integrator=integrator, d=d, size=size, spacing=0.05 if d == 2 else 0.08, flux=flux)


@pytest.mark.parametrize("integrator, kernel", both(("euler", "cubic"), ("", "wendland4"), ("", "quintic")))
def test_sums_with_other_kernels(integrator, kernel):
    check(ROUNDING, integrator=integrator, d=2, kernel=kernel, periodic=("y",))


@pytest.mark.parametrize("integrator, flux", both(("", "none"), ("symplectic", "molteni")))
def test_rates_by_masses_are_those_over_all_pairs(integrator, flux):
    check(ROUNDING, integrator=integrator, d=2, flux=flux, continuity="masses", density=50.0)


@pytest.mark.parametrize(
    "integrator, form",
    both(("", "cleary"), ("euler", "morris"), ("symplectic", "strain-rate"), ("", "full-stress")),
)
def test_sums_with_viscosity(integrator, form):
    check(ROUNDING, integrator=integrator, d=2, form=form, viscosity=5.0)


@pytest.mark.parametrize("integrator", both(("symplectic",)))
def test_sums_with_corrections(integrator):
    more = {"tensile": 0.2, "corrected": "true"}
    check(1e-11, integrator=integrator, density=20.0, d=3, spacing=0.1, **more)  # of the inverse matrices too


@pytest.mark.parametrize("integrator", both(("euler",)))
def test_drag_with_corrected_gradients(integrator):
    check(1e-11, integrator=integrator, d=2, form="morris", viscosity=5.0, corrected="true")  # as above


def test_corrected_gradients_are_exact_for_linear_fields():
    """rho = rho0 + b.x leaves no delta flux; v = G x has d rho / dt = - rho tr G, at the free surface too."""
    sph = engine(integrator="euler", d=2, corrected="true", flux="none", alpha=0.0, gravity=(0.0, 0.0), pressure="zero")
    jitter(sph, density=0.0, speed=0.0)
    gradient = np.array([[1.0, 2.0], [-3.0, 4.0]])
    sph.storage.set_own_values("v", gradient @ sph.storage.own_values("x"))
    sph.evolution.evaluate()
    error = np.sort(np.abs(column(sph, "rate") / sph.scene.rho0 + np.trace(gradient)))
    assert error[-5] < 1e-12 * np.abs(gradient).sum()  # but for corners with too few neighbours


@pytest.mark.parametrize("d, precision", [(2, "double"), seldom(3, "single")])
def test_moments_are_those_over_all_pairs_and_move_no_bit(d, precision):
    """In 3D the storage has the axis of gravity first. A run that tells them goes on as one that does not."""
    settings = {"d": d, "size": (1.0, 1.0, 1.3)[:d], "spacing": 0.05 if d == 2 else 0.08, "precision": precision}
    settings |= {} if d == 2 else {"flux": "delta"}  # for kernels that others have
    told, plain = (engine(**settings, more=more) for more in ("output = { moments = true; };", ""))
    for sph in (told, plain):
        jitter(sph)
    (found,) = told.particles().values()
    order = np.argsort(found.ids)
    m0, m1, slope0, slope1 = reference(told).kernel_moments()
    axes = [told.scene.axes.index(k) for k in range(d)]
    rows = {f"slope_1{'xyz'[k]}": slope1[:, axes[k], axes] for k in range(d)}
    for name, wanted in ({"moment_0": m0[:, None], "moment_1": m1[axes].T, "slope_0": slope0[axes].T} | rows).items():
        seen = found.columns[name][order].reshape(len(order), -1)[:, : wanted.shape[1]]
        assert np.abs(seen - wanted).max() < SINGLE, name  # snapshots hold float32
    for sph in (told, plain):
        sph.step()
        sph.particles()
        sph.step()
    assert all(np.array_equal(a, b) for a, b in zip(by_id(told, "x", "v", "drho"), by_id(plain, "x", "v", "drho")))


def test_moments_are_told_of_walls_too():
    """A snapshot has the same columns of all its particles. The fluid before a wall fills less than half of its W."""
    sph = engine(spacing=0.1, more=tank(2) + "output = { moments = true; };")
    fluid, wall = sph.particles().values()
    assert list(fluid.columns) == list(wall.columns)
    assert 0.1 < wall.columns["moment_0"].max() < 0.5 and 0.9 < fluid.columns["moment_0"].max() < 1.1


def test_shifting_pushes_particles_towards_the_lattice():
    still = {"gravity": (0.0, 0.0), "pressure": "zero", "alpha": 0.0}
    sph = engine(d=2, shifting="true", periodic=("x", "y"), fill=1.0, **still)
    x = by_id(sph, "x")[0]
    jitter(sph, amount=0.1, speed=0.0, density=0.0)
    ids = sph.storage.own_values("id")
    away = sph.storage.own_values("x") - x[:, ids]
    away -= np.rint(away)  # around the unit box
    sph.evolution.evaluate_forces()
    offset = sph.storage.own_values("offset")
    assert np.sum(away * offset) < -0.5 * np.sqrt(np.sum(away**2) * np.sum(offset**2))


@pytest.mark.parametrize("integrator, d", both(("symplectic", 2), ("", 3)))
def test_sums_around_a_periodic_box(integrator, d):
    more = {"periodic": ("x", "y", "z")[:d], "flux": "delta"}
    check(ROUNDING, integrator=integrator, d=d, fill=1.0, spacing=0.05 if d == 2 else 0.125, **more)


@pytest.mark.parametrize("integrator", both(("symplectic",)))
def test_sums_in_single_precision(integrator):
    check(SINGLE, integrator=integrator, d=3, spacing=0.08, precision="single", flux="delta")


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sums_far_away(axis):
    """Neighbours are found from places in single precision, whose rounding is reckoned with: 0.06 m and more here."""
    sph = engine(integrator="euler", d=3, spacing=0.1)
    jitter(sph)
    sph.storage.x[axis, sph.storage.own_slots] += 1e6
    sph.sort()
    expected = reference(sph).acceleration()
    sph.evolution.evaluate()
    assert np.abs(by_id(sph, "a")[0] - expected).max() <= ROUNDING * np.abs(expected).max()


@pytest.mark.parametrize("integrator", ["rk3-tvd"])
def test_sums_of_stages_use_the_neighbours_of_the_start(integrator):
    """Particles that have moved as far as the sort allows still find each other."""
    sph = engine(d=2, integrator=integrator, cfl=1.0)
    jitter(sph)
    ids = sph.storage.own_values("id")
    direction = np.random.default_rng(3).uniform(0, 2 * np.pi, len(ids))[ids]
    sph.skin.reach = sph.skin.farthest
    sph.sort()
    sph.storage.set_own_values(
        "x", sph.storage.own_values("x") + sph.skin.reach * np.array([np.cos(direction), np.sin(direction)])
    )
    expected = reference(sph)
    sph.evolution.evaluate()
    assert np.abs(by_id(sph, "a")[0] - expected.acceleration()).max() <= ROUNDING * np.abs(by_id(sph, "a")[0]).max()


def test_momentum_and_diffused_density_are_conserved():
    """Pair forces are opposite; the flux takes from one particle what it gives to the other, by volume."""
    sph = engine(integrator="euler", d=3, fill=1.0, spacing=0.125, flux="delta", periodic=("x", "y", "z"))
    jitter(sph)
    sph.evolution.evaluate()
    a, rate, drho, m = by_id(sph, "a", "rate", "drho", "m")
    assert np.abs((m * a).sum(axis=1)).max() <= 1e-12 * np.abs(m * a).sum()
    plain = engine(integrator="euler", d=3, fill=1.0, spacing=0.125, flux="none", periodic=("x", "y", "z"))
    jitter(plain)
    plain.evolution.evaluate()
    diffusion = (rate - by_id(plain, "rate")[0]) * m / (sph.scene.rho0 + drho)
    assert np.abs(diffusion).sum() > 0
    assert abs(diffusion.sum()) <= 1e-12 * np.abs(rate * m / sph.scene.rho0).sum()


def test_a_still_patch_has_no_acceleration_inside():
    sph = engine(integrator="euler", d=2, gravity=(0.0, 0.0), pressure="zero", periodic=("x", "y"), fill=1.0)
    sph.storage.set_own_values("drho", 3.0)
    sph.evolution.evaluate()
    a, rate = by_id(sph, "a", "rate")
    scale = sph.scene.c0**2 / sph.scene.h  # of an acceleration by a pressure difference of rho c^2 over h
    assert np.abs(a).max() <= 1e-14 * scale
    assert np.abs(rate).max() == 0.0


def test_coincident_particles_do_not_push_each_other():
    sph = engine(integrator="euler", d=2, kernel="cubic", gravity=(0.0, 0.0), periodic=("y",))
    first, second = sph.storage.own_slots[:2]
    sph.storage.x[:, second] = sph.storage.x[:, first]
    sph.sort()
    sph.evolution.evaluate()
    assert all(np.isfinite(column(sph, name)).all() for name in ("a", "rate"))
