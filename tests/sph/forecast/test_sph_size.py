"""A case that is too large for the machine is told at once, before anything of it is made."""

import pytest
from test_sph_plausibility import PARTS

from hpcpic.core import memory
from hpcpic.core.case.config import load, loads
from sph.configure import configure
from sph.forecast import derived, estimate, plan, size

TEXT = "\n".join(f"{name} = {value};" for name, value in PARTS.items())
FINE = TEXT.replace("spacing = 0.05", "spacing = 2.0e-5")


@pytest.fixture
def not_made(monkeypatch):
    for module in (derived, plan):
        monkeypatch.setattr(module, "Scene", None)


def test_a_case_that_fits_is_not_told_its_size():
    assert not list(size.size(configure(loads(TEXT)), 1))


@pytest.mark.parametrize("ranks, told", [(1, 1), (1000, 0)])
def test_memory_that_is_not_there_is_told_before_particles_are_made(ranks, told, not_made, monkeypatch):
    monkeypatch.setattr(memory, "free", lambda: 8 * size.GIB)
    config = configure(loads(FINE))
    found = [number for number in size.size(config, ranks) if number.name == "memory of a rank"]
    assert len(found) == told
    if told:
        assert derived.derived(config, ranks)[-1] == found[0]
        needed = estimate.estimate(config, ranks, 1, {}).memory
        assert found[0].value == pytest.approx(sum(needed.values()) / size.GIB, rel=0.01)
        cured = FINE.replace("2.0e-5", found[0].cure.split()[2].strip(","))
        assert not list(size.size(configure(loads(cured)), 1))


def test_particles_that_are_not_counted_one_by_one_are_as_many(monkeypatch):
    config = configure(loads(TEXT.replace("spacing = 0.05", "spacing = 0.01")))
    n, _ = plan.counts(config)
    monkeypatch.setattr(plan, "MOST_COUNTED", 100)
    assert plan.counts(config)[0] == n == 3000
    assert plan.images(config) == 0.0


@pytest.mark.parametrize("factor, warns, fails", [(0.3, 0, 0), (300.0, 1, 1)])
def test_a_file_in_millimetres_is_told_by_its_length(factor, warns, fails, tmp_path, not_made):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((factor, factor, factor)).export(tmp_path / "raft.stl")
    (tmp_path / "raft.conf").write_text("""simulation = { dimensions = 3; end_time = 1.0; };
        gravity = [0.0, 0.0, -9.81]; numerics = { spacing = 0.05; };
        fluid = ( { shape = { box = { low = [0.0, 0.0, 0.0]; high = [1.0, 1.0, 0.4]; }; }; } );
        wall = ( { name = "tank"; shape = { box = { low = [0.0, 0.0, 0.0]; high = [1.0, 1.0, 1.0]; }; }; },
          { name = "raft"; solid = true; body = { density = 500.0; };
            shape = { stl = { file = "raft.stl"; }; }; } );""")
    found = list(size.size(configure(load(str(tmp_path / "raft.conf"))), 1))
    long = [number for number in found if number.name == "length of raft"]
    assert [(number.verdict, number.value) for number in long] == [("warn", pytest.approx(factor))] * warns
    assert all("tank is 1 m long" in str(number) and "scale = 0.001" in number.cure for number in long)
    assert sum(number.name == "places of raft on the lattice" and number.verdict == "fail" for number in found) == fails
