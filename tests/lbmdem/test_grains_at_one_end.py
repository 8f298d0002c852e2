"""Laws of cuts by cost: of grains at one end of the box at the start, as they move, after a restart; of even cost."""

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.run import balance
from hpcpic.core.run.checkpoint import digest
from hpcpic.core.space.domain import MAX_IMBALANCE, better_cuts, even_cuts, fullest
from lbmdem.app import shipped_cases
from lbmdem.configure import configure
from lbmdem.forecast import cuts
from lbmdem.forecast.plan import plan

ROWS = 48
BOX = """
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ size = {size}; spacing = 0.0002; periodic = {periodic}; }};
fluid = {{ viscosity = 1.0e-6; relaxation_time = 0.8; body_force = {force}; }};
coupling = {{ substeps = 64; }};
contact = {{ normal_stiffness = {stiffness}; damping = 0.3; tangential = "history"; friction = 0.4; }};
grains = ({{ diameter = 1.0e-3; density = 2650.0; velocity = {velocity}; position = ({places}); }});
"""
SPACING = 2.0e-4


def scene(d, turned=False, dry=False, sets=()):
    """Grains that touch in the first quarter of the box along the last axis; turned: in the last one. By itself a step
    would take 1400 substeps in 3D and, for the films, 1000 in 2D: ranks send messages in each.
    """
    side = [10 * SPACING] * (d - 1)
    places = np.stack(np.meshgrid(*[[2.5, 7.48]] * (d - 1), [2.6, 7.55], indexing="ij"), -1).reshape(-1, d) * SPACING
    if turned:
        places[:, -1] = ROWS * SPACING - places[:, -1]
    text = BOX.format(
        d=d, stiffness={2: 20.0, 3: 0.02}[d], size=[*side, ROWS * SPACING], periodic='["x"]', force=[0.1] * d,
        velocity=[1e-3] * (d - 1) + [2e-3], places=", ".join(map(str, places.tolist())),
    )  # fmt: skip
    if dry:
        text = "\n".join(line for line in text.splitlines() if not line.startswith(("fluid", "coupling")))
        text = text.replace("end_time = 1.0;", "end_time = 1.0; time_step = 1.0e-6;")
    return configure(loads(text, sets=sets))


def found(app):
    """The state, and what is asked of it."""
    return digest(app.world, app.state()), app.scalars()


def alone(case, steps):
    with running(World.alone(), "lbmdem", case) as app:
        for _ in range(steps):
            app.step()
        return found(app)


def is_even(app):
    """No other cuts are better by MAX_IMBALANCE."""
    return better_cuts(app.row_costs(), app.domain.cuts, minimum=1) is None


def costs(case, x):
    placed = cuts.Grains(x, np.full(len(x), 2.5))
    return cuts.row_costs(case, cuts.sums_by_row(case, placed))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("ranks", [2, 3, 5])
def test_no_rank_has_more_than_the_mean_and_a_row_at_the_start(d, ranks):
    case = scene(d)
    cost, made = costs(case, np.array(case.grains[0].centres)[:, -1]), cuts.first_cuts(case, ranks)
    assert fullest(cost, made) <= cost.sum() / ranks + cost.max()
    assert fullest(cost, even_cuts(ROWS, ranks)) > MAX_IMBALANCE * fullest(cost, made)
    told = next(line for line in plan(case, ranks, 1) if line.startswith("  rows"))
    assert [int(word) for word in told.split()[1:]] == np.diff(made).tolist()


@pytest.mark.parametrize("name", ["poiseuille", "sphere-array", "taylor-green", "couette"])
def test_even_cost_is_cut_evenly(name):
    case = configure(loads(shipped_cases()[name].read_text()))
    for ranks in (1, 2, 4):
        assert cuts.first_cuts(case, ranks) == even_cuts(case.points[-1], ranks)


KINDS = {
    "discs": (2, ()),
    "spheres": (3, ()),
    "average": (2, ('coupling.refill="average"',)),
    "non-equilibrium": (2, ('coupling.refill="non-equilibrium"',)),
    "conserving": (3, ('coupling.refill="conserving"',)),
    "fixed": (3, ("grains[0].moving=false",)),
    "seen at rest": (3, ("coupling.frozen=true",)),
    "dry": (3, ()),
}


@pytest.fixture
def few_are_many(monkeypatch):
    """As if there were too many grains for all ranks to hold all."""
    monkeypatch.setattr(cuts, "MAX_REPLICATED", 0)
    monkeypatch.setattr("lbmdem.grains.grains.MAX_REPLICATED", 0)


@pytest.mark.timeout(300)  # it may have to compile
@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("kind", KINDS)
def test_ranks_with_uneven_slabs_give_the_bits_of_one(few_are_many, kind):
    world, (d, sets) = World.start(), KINDS[kind]
    case = scene(d, dry=kind == "dry", sets=sets)
    with running(world, "lbmdem", case) as app:
        assert app.domain.cuts == cuts.first_cuts(case, world.size)
        assert app.domain.cuts != even_cuts(ROWS, world.size) or kind == "fixed"
        for k in range(8):
            if k == 5:
                app.balance.move((*range(world.size), ROWS))  # slabs of a row
            app.step()
        together = found(app)
    assert not world.any(together != alone(case, 8))


@pytest.mark.timeout(300)  # it may have to compile
@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("kind", ["discs", "spheres", "dry"])
def test_cuts_follow_the_grains_when_that_is_worth_laying_out(monkeypatch, few_are_many, kind):
    """From the other end of the box, as after a restart on other cuts, and back again."""
    world, (d, sets), dry = World.start(), KINDS[kind], kind == "dry"
    monkeypatch.setattr(balance, "PERIOD", 3)
    monkeypatch.setattr(cuts, "LAYING_OUT", (0.0, 0.0, 0.0))
    case, turned = scene(d, dry=dry, sets=sets), scene(d, turned=True, dry=dry, sets=sets)
    with running(World.alone(), "lbmdem", turned) as app:
        for _ in range(2):
            app.step()
        there = balance.StateInMemory(app.world, app.iteration, app.time, app.state())
        app.step(), app.step()
        expected = found(app)
    with running(world, "lbmdem", case) as app:
        at_one_end = app.domain.cuts
        app.restore(there)
        assert is_even(app)
        app.balance.move(at_one_end)
        assert not is_even(app)
        app.step()
        assert app.domain.cuts == at_one_end
        app.step()  # from step 3
        assert is_even(app)
        assert not world.any(found(app) != expected)


@pytest.mark.timeout(300)
@pytest.mark.mpi(min_size=2)
def test_what_was_seen_is_known_on_other_cuts():
    world = World.start()
    with running(world, "lbmdem", scene(2)) as app:
        app.step()
        app.scalars()
        app.diagnostics._warned.add("speed")
        app.grains.worst_film, app.grain_bits.trouble = 0.5, "damaged"
        seen = app.diagnostics.fluid.drift, app.diagnostics.fluid.fastest
        app.balance.move((*range(world.size), ROWS))
        assert "speed" in app.diagnostics._warned and app.grains.worst_film == 0.5
        assert "damaged" in app.guard()
        assert (app.diagnostics.fluid.drift, app.diagnostics.fluid.fastest) == seen
