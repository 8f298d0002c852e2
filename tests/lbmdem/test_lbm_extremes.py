"""LBM-DEM at the extremes: accurate (A), warned (B), refused (C) or told to diverge (D); never silently wrong."""

import math

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.errors import ConfigError, Diverged
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived

DX, NU = 2.0e-4, 1.0e-6
LAYER = f"""
simulation = {{ end_time = 1.0; }};
domain = {{ size = [{32 * DX!r}, {32 * DX!r}]; spacing = {DX}; periodic = ["x", "y"]; }};
fluid = {{ viscosity = {NU}; relaxation_time = 0.8; initial = {{ flow = "shear-layer"; speed = 1.0e-9; }}; }};
"""
CHANNEL = f"""
simulation = {{ end_time = 1.0; }};
domain = {{ size = [{4 * DX!r}, {16 * DX!r}]; spacing = {DX}; periodic = ["x"]; }};
fluid = {{ viscosity = {NU}; relaxation_time = 0.8; body_force = [1.0e-4, 0.0]; }};
"""
DISC = f"""
simulation = {{ end_time = 1.0; }};
domain = {{ size = [{40 * DX!r}, {40 * DX!r}]; spacing = {DX}; }};
fluid = {{ viscosity = {NU}; relaxation_time = 0.8; }};
grains = ({{ name = "disc"; diameter = {10 * DX!r}; density = 2650.0; position = [0.0041, 0.0047]; }});
contact = {{ normal_stiffness = 100.0; damping = 0.5; friction = 0.3; }};
gravity = [0.0, -1.0e-3];
"""
PIPE = f"""
simulation = {{ end_time = 1.0; }};
domain = {{ size = [{24 * DX!r}, {16 * DX!r}]; spacing = {DX}; periodic = ["y"]; }};
fluid = {{ viscosity = {NU}; relaxation_time = 0.8; }};
boundary = ({{ face = "x-"; type = "pressure"; density = 1000.0; }},
            {{ face = "x+"; type = "pressure"; pressure = 0.0; }});
"""
STEPS = 60


def ended(world, case, sets=(), *, force=False, steps=STEPS):
    """(class, what was said) of a case on one rank, as `run` does it, the guard asked after every tenth step."""
    said = []
    try:
        tree = loads(case, sets=sets)
        config = configure(tree)
        said += enforce(derived(config, world.size), tree, force)
        with running(world, "lbmdem", case, sets) as app:
            last = app.scalars()
            for n in range(steps):
                app.step()
                if n % 10 == 9:
                    last = app.scalars()
                if app.guard():
                    return "D", [app.guard()]
    except ConfigError as error:
        return "C", error.messages
    except Diverged as error:
        return "D", [error.message]
    assert all(math.isfinite(value) for value in last.values()), last
    return "B" if said else "A", said


def layer(mach=0.0999, tau=0.8, collision="TRT"):
    speed = mach / math.sqrt(3.0) * 3.0 * NU / ((tau - 0.5) * DX)
    return LAYER, (f"fluid.relaxation_time={tau}", f"fluid.initial.speed={speed!r}", f'fluid.collision="{collision}"')


def channel(tau, collision):
    force = f"fluid.body_force=[{1e-5 / tau}, 0.0]"
    return CHANNEL, (f"fluid.relaxation_time={tau}", f'fluid.collision="{collision}"', force)


def ratio(value, inertia="implicit"):
    """A disc of so many times the fluid's density, of the same weight for all."""
    gravity = 2e-3 / max(abs(value - 1.0), 0.01)
    return DISC, (f"grains[0].density={1e3 * value!r}", f"gravity=[0.0, {-gravity!r}]", f'coupling.inertia="{inertia}"')


def wide(nodes):
    return DISC, (f"grains[0].diameter={nodes * DX!r}",)


def at(*points, **more):
    """Discs of 10 nodes at these places, in nodes."""
    places = ", ".join(f"[{x * DX!r}, {y * DX!r}]" for x, y in points)
    others = (f"{key.replace('__', '.')}={value}" for key, value in more.items())
    return DISC, (f"grains[0].position=({places})", *others)


def stiff(value):
    return DISC, (f"contact.normal_stiffness={value!r}",)


def dense(start, rate=0.0, end=1.0):
    density, falls = f"boundary[0].density={start!r}", f"boundary[0].pressure_rate={rate!r}"
    return PIPE, (density, falls, f"simulation.end_time={end!r}")


def filled(shape):
    return LAYER + f"obstacle = ({{ shape = {{ {shape}; }}; }});", ()


HALF = "one half"  # of the nodes, which are not held then: 12 s to compile, see test_sparse
SEAM = {"domain__periodic": '["x", "y"]'}
TABLE = {
    "tau": [
        *((f"{t}", "A", layer(tau=t)) for t in (0.52, 0.8, 1.0, 2.0, 5.0)),
        ("0.505", "B", layer(tau=0.505)),
        ("0.5001", "CB", layer(tau=0.5001)),
        ("0.5001 central", "A", layer(tau=0.5001, collision="central")),
        ("0.5", "CC", (LAYER, ("fluid.relaxation_time=0.5",))),
        *((f"{t} TRT, walls", "A", channel(t, "TRT")) for t in (2.0, 5.0)),
        *((f"{t} BGK, walls", "B", channel(t, "BGK")) for t in (2.0, 10.0)),
        ("10.5 TRT", "B", channel(10.5, "TRT")),
        ("1000", "CC", channel(1e3, "TRT")),
    ],
    "Mach": [
        *((f"{m}", "A", layer(m)) for m in (0.01, 0.05, 0.1)),
        *((f"{m}", "B", layer(m)) for m in (0.2, 0.3)),
        ("0.5", "CB", layer(0.5)),
        ("0.9", "CD", layer(0.9)),
        ("1.1", "CC", layer(1.1)),
    ],
    "density ratio": [
        *((f"{r}", "B", ratio(r)) for r in (0.001, 0.01, 0.1)),
        *((f"{r}", "A", ratio(r)) for r in (1.0, 1.001, 1.01, 2.65, 10.0, 1000.0)),
        ("1.01 explicit", "A", ratio(1.01, "explicit")),
        ("0.2 explicit", "B", ratio(0.2, "explicit")),
        ("0.01 explicit", "CD", ratio(0.01, "explicit")),
    ],
    "D/dx": [
        *((f"{n}", "A", wide(n)) for n in (10, 16)),
        *((f"{n}", "B", wide(n)) for n in (5, 3)),
        ("2", "CB", wide(2)),
        ("0.5", "CC", wide(0.5)),
    ],
    "gap": [
        ("0.3 nodes", "A", at((15.1, 20.3), (25.4, 20.3))),
        ("0.3 nodes, bare", "B", at((15.1, 20.3), (25.4, 20.3), coupling__lubrication="false")),
        ("0 nodes", "A", at((15.1, 20.3), (25.1, 20.3))),
    ],
    "k_n": [
        *((f"x {k:g}", "A", stiff(100.0 * k)) for k in (1.0, 1e3, 1e6)),
        ("x 1e-3", "B", stiff(0.1)),
        ("x 1e-5", "CC", stiff(1e-3)),
    ],
    "n_d": [
        ("1", "CC", (DISC, ("coupling.substeps=1",))),
        ("10000", "A", (DISC, ("coupling.substeps=10000",))),
        ("dt of the fluid below that of the contacts", "A", (DISC, ("fluid.relaxation_time=0.51",))),
    ],
    "place": [
        ("on the seam", "A", at((40.0, 40.0), **SEAM)),
        ("half over it", "A", at((0.0, 20.0), **SEAM)),
        ("outside", "CC", at((41.0, 20.0))),
        ("outside a periodic box", "A", at((41.0, 20.0), **SEAM)),
        ("as large as the box", "CC", wide(41)),
    ],
    "solid": [
        ("0 grains", "A", (DISC.split("grains")[0], ())),
        ("everything", "CC", filled("box = { low = [-1.0, -1.0]; high = [1.0, 1.0] }")),
        *((name, "A", filled(f"box = {{ low = [-1.0, 0.0]; high = [1.0, {rows * DX!r}] }}"))
          for name, rows in (("a tenth", 3.2), (HALF, 16.2))),
    ],
    "pressure": [
        ("rho = 0.99", "A", dense(990.0)),
        ("rho = 0.89", "B", dense(890.0, end=0.1)),
        ("rho = 0.45", "CD", dense(450.0)),
        ("falls to nothing", "CC", dense(1000.0, -1e3)),
    ],
    "overlap at the start": [
        ("1 %", "A", at((15.1, 20.3), (25.05, 20.3))),
        ("2 %", "B", at((15.1, 20.3), (24.9, 20.3))),
        ("50 %", "CD", at((15.1, 20.3), (20.1, 20.3))),
        ("50 %, soft: the mass drifts", "CD",
         at((15.1, 20.3), (20.1, 20.3), contact__normal_stiffness=1.0, coupling__refill='"local"')),
        ("with a wall", "CD", at((3.0, 20.3))),
        ("same centres", "CC", at((15.1, 20.3), (15.1, 20.3))),
    ],
    "steps": [("a viscosity in mm2/s, for 1000 s", "B", (LAYER, ("fluid.viscosity=1.0", "simulation.end_time=1000")))],
}  # fmt: skip
ROWS = [
    pytest.param(expected, *scene, id=f"{what} {value}", marks=[pytest.mark.validation] if value == HALF else [])
    for what, rows in TABLE.items()
    for value, expected, scene in rows
]


@pytest.mark.parametrize("expected, case, sets", ROWS)
def test_table(world, expected, case, sets):
    """Two letters: without and with --force. What is refused says the limit and what to do."""
    found, said = ended(world, case, sets)
    assert found == expected[0], said
    if found == "C":
        told = " ".join(said)
        assert "limit" in told or "must" in told or "fill the whole" in told or "greater" in told, told
        forced, warnings = ended(world, case, sets, force=True, steps=5 * STEPS)
        assert forced == expected[1], warnings
        assert forced in "CD" or any("refused without --force" in warning for warning in warnings)


GRAIN = 2.0**-12  # m, a node
SCALED = """
simulation = {{ end_time = {end!r}; }};
domain = {{ size = [{width!r}, {height!r}]; spacing = {dx!r}; periodic = ["x"]; }};
fluid = {{ density = {rho!r}; viscosity = {nu!r}; relaxation_time = 0.8; storage = "{storage}";
          body_force = [{f!r}, 0.0]; initial = {{ flow = "taylor-green"; speed = {u!r}; }}; }};
boundary = ({{ face = "y+"; type = "pressure"; pressure = {p!r}; }});
grains = ({{ diameter = {d!r}; density = {heavy!r}; position = ([{x1!r}, {y1!r}], [{x2!r}, {y2!r}]); }});
contact = {{ normal_stiffness = {k!r}; damping = 0.5; tangential = "history"; friction = 0.3; }};
coupling = {{ substeps = 20; frozen = {frozen}; }};
gravity = [0.0, {g!r}];
"""


def scaled(storage, frozen, m, s, kg):
    """Two discs that touch each other and the floor, in units of m metres, s seconds and kg kilograms."""
    node = GRAIN * m
    return SCALED.format(
        storage=storage, frozen=frozen, end=1.0 * s, width=24 * node,
        height=20 * node, dx=node, rho=997.0 * kg / m**3,
        nu=1.1e-6 * m * m / s, d=6.0 * node, heavy=2650.0 * kg / m**3, x1=5.3 * node, y1=2.9999 * node,
        x2=10.1 * node, y2=6.5995 * node, k=50.0 * kg / m / s**2, g=-0.013 * m / s**2,
        f=1.3e-3 * m / s**2, u=1.7e-4 * m / s, p=0.3e-3 * kg / m / s**2,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("storage", "frozen"),
    [("double", "false"), ("single", "true"), pytest.param("single", "false", marks=pytest.mark.validation)],
)  # links that move are compiled for double by default
def test_units_by_powers_of_two_give_the_same_bits(world, storage, frozen):
    """Metres, seconds and kilograms 2^20, 2^-13 and 2^7 times as large: the state differs by powers of two alone."""

    def state(*units):
        with running(world, "lbmdem", scaled(storage, frozen, *units)) as app:
            for _ in range(30):
                app.step()
            return {name: shard.local.copy() for name, shard in app.state().items()}, app.scalars()

    (plain, first), (other, second) = state(1.0, 1.0, 1.0), state(2.0**20, 2.0**-13, 2.0**7)
    assert first["contact_count"] >= 2
    assert plain["populations"].any()
    for name, values in plain.items():
        mantissas, far = np.frexp(values)[0], np.frexp(other[name])[0]
        assert np.array_equal(mantissas, far), name
    for name, value in first.items():
        assert math.frexp(value)[0] == math.frexp(second[name])[0], name


@pytest.mark.parametrize("case, sets", [(DISC, ('coupling.refill="conserving"', "gravity=[0.0, -0.1]")), layer()])
def test_populations_that_come_from_nowhere_end_a_run_where_their_sum_is_kept(world, case, sets):
    """A millionth of the mean density; without it the sum stays to rounding, with nodes covered and uncovered."""
    with running(world, "lbmdem", case, sets) as app:
        jumps, start = [], app.fluid.ids.copy()
        for _ in range(100):
            app.step()
            app.scalars()
            jumps.append(abs(app.diagnostics.fluid.jump))
        assert max(jumps) < 1e-15 and app.guard() is None
        assert np.any(app.fluid.ids != start) == (case == DISC)
        h = app.fluid.populations()
        h[3, 1, 1] += 1e-6 * h[0].size
        app.fluid.set_populations(h)
        app.scalars()
        assert "jumped" in app.guard()


@pytest.mark.parametrize(
    "name, column, said", [("row", 4, "places, velocities or sizes of grains"), ("force", 0, "forces on grains")]
)
def test_a_grain_that_changes_between_its_steps_is_told(world, name, column, said):
    with running(world, "lbmdem", DISC, ()) as app:
        for _ in range(5):
            app.step()
        assert app.guard() is None
        number = app.dem.grains.columns[name][0]
        number[column] = np.nextafter(number[column], 1.0)
        app.step()
        assert app.guard().startswith(f"{said} changed by themselves before step 5")


def test_many_substeps_are_told_with_the_stiffness_that_has_fewer():
    def row(*sets):
        config = configure(loads(DISC, sets=sets))
        return next(line for line in derived(config, 1) if line.symbol == "n_d")

    stiff = row("contact.normal_stiffness=1e8")
    softer = float(stiff.source.split("=")[1].split()[0])
    assert stiff.value > 1000 and row(f"contact.normal_stiffness={softer!r}").value == pytest.approx(1000, rel=0.05)
    assert not row().source


@pytest.mark.parametrize(("d", "across", "nodes"), [(2, 10, 40), (3, 7, 24)])
def test_explicit_coupling_explodes_where_check_says(world, d, across, nodes):
    """Theory ends at half the impedance of the links, which is the limit told / 1.2."""
    text = f"""
    simulation = {{ dimensions = {d}; end_time = 100.0; }};
    domain = {{ size = [{", ".join([str(nodes * DX)] * d)}]; spacing = {DX};
                periodic = [{", ".join(f'"{axis}"' for axis in "xyz"[:d])}]; }};
    fluid = {{ viscosity = {NU}; relaxation_time = 0.6; }};
    coupling = {{ inertia = "explicit"; substeps = 1; }};
    grains = ({{ diameter = {across * DX}; position = [{", ".join([str((nodes / 2 + 0.3) * DX)] * d)}]; }});
    contact = {{ normal_stiffness = 1.0e-3; damping = 0.3; friction = 0.3; }};
    gravity = [{", ".join(["0.0"] * (d - 1) + ["-1.0e-3"])}];
    """
    config = configure(loads(text))
    row = next(number for number in derived(config, 1) if number.name == "density ratio")
    limit = float(row.limit.split()[1])
    for share, stable in ((0.9 / 1.2, False), (1.02, True)):
        with running(world, "lbmdem", text, (f"grains[0].density={1e3 * limit * share!r}",)) as app:
            fastest = 0.0
            while app.iteration < 300 and fastest < 0.3:
                app.step()
                fastest = np.abs(app.dem.grains.v).max() * app.time_step / DX
            assert (fastest < 0.3) == stable
