"""The files follow openPMD 1.1.0, as its validator sees it, and hold what they were given."""

import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.arrays import FieldArray, ParticleArray
from hpcpic.core.files.openpmd import OpenPMDWriter, dimension
from hpcpic.core.files.together import ALONE
from hpcpic.core.space.domain import Domain, block_ranges, even_cuts

N = 11


def arrays(points: tuple[int, ...]) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    return {
        "rho": rng.random(points),
        "E": rng.random((*points, len(points))),
        "id": rng.permutation(N),
        "position": rng.random((N, 3)),
        "velocity": rng.random((N, 2)),
        "charge": rng.random(N),
        "orientation": rng.random((N, 4)),
    }


def write(world, folder: Path, points: tuple[int, ...], after: int | None = None, step: int = 30) -> Path:
    box = Domain(tuple(0.5 * n for n in points), points, (True,) * len(points), even_cuts(points[0], world.size))
    low, high = box.row_range(world.rank)
    first, last = block_ranges(N, world.size)[world.rank]
    a = arrays(points)
    fields = {"rho": FieldArray(a["rho"][low:high], "C/m2"), "E": FieldArray(a["E"][low:high], "V/m")}
    part = {name: a[name][first:last] for name in ("velocity", "charge", "orientation")}
    ions = ParticleArray(
        a["id"][first:last], a["position"][first:last], part, {"velocity": "m/s", "charge": "C"}, {"velocity": -0.125}
    )
    none = ParticleArray(np.arange(0), np.zeros((0, 3)))
    OpenPMDWriter(world, folder, 0.25, after).append(step, 7.5, box, fields, {"ions": ions, "none": none})
    return folder / f"data{step:08d}.h5"


def assert_holds(path: Path, points: tuple[int, ...]) -> None:
    a = arrays(points)
    with h5py.File(path, "r") as file:
        iteration = file["data/30"]
        assert (iteration.attrs["time"], iteration.attrs["dt"]) == (7.5, 0.25)
        rho = iteration["meshes/rho"]
        assert np.array_equal(rho, a["rho"])
        assert rho.attrs["gridSpacing"].tolist() == [0.5] * len(points)
        assert [label.decode() for label in rho.attrs["axisLabels"]] == ["z", "y", "x"][3 - len(points) :]
        assert rho.attrs["unitDimension"].tolist() == [-2, 0, 1, 1, 0, 0, 0]
        for c in range(len(points)):
            assert np.array_equal(iteration["meshes/E"]["xyz"[c]], a["E"][..., c])
        ions = iteration["particles/ions"]
        assert np.array_equal(ions["id"], a["id"]) and np.array_equal(ions["charge"], a["charge"])
        for c, axis in enumerate("xyz"):
            assert np.array_equal(ions["position"][axis], a["position"][:, c])
        assert np.array_equal(ions["velocity/y"], a["velocity"][:, 1])
        assert np.array_equal(ions["orientation/w"], a["orientation"][:, 0])
        assert ions["velocity"].attrs["unitDimension"].tolist() == [1, 0, -1, 0, 0, 0, 0]
        assert (ions["velocity"].attrs["timeOffset"], ions["charge"].attrs["timeOffset"]) == (-0.125, 0.0)


@pytest.mark.parametrize("points", [(16,), (6, 5), (4, 3, 5)])
def test_validator_finds_no_error(tmp_path: Path, points: tuple[int, ...]) -> None:
    path = write(ALONE, tmp_path, points)
    assert_holds(path, points)
    program = Path(sys.executable).with_name("openPMD_check_h5")
    check = subprocess.run([program, "-i", path], capture_output=True, text=True, timeout=60)
    assert check.returncode == 0 and "Result: 0 Errors" in check.stdout, check.stdout


def test_units_are_taken_apart() -> None:
    assert dimension("") == dimension("1") == (0,) * 7
    assert dimension("rad/s") == dimension("s^-1") == (0, 0, -1, 0, 0, 0, 0)  # of turning grains
    assert dimension("V/m") == (1, 1, -3, -1, 0, 0, 0)
    assert dimension("kg m/s") == dimension("N*s") == (1, 1, -1, 0, 0, 0, 0)
    assert dimension("C/m^2") == dimension("C m^-2") == dimension("C/m2") == (-2, 0, 1, 1, 0, 0, 0)
    with pytest.raises(ValueError, match="'furlong' is not known"):
        dimension("furlong/s")


def test_a_restart_removes_later_files_and_a_failure_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for step in (10, 20, 30):
        write(ALONE, tmp_path, (6, 5), step=step)
    write(ALONE, tmp_path, (6, 5), after=10, step=15)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data00000010.h5", "data00000015.h5"]

    def fail(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(image, "write_shards", fail)
    with pytest.raises(FileError, match=r"cannot write .*data00000020.h5: No space left on device; free some"):
        write(ALONE, tmp_path, (6, 5), step=20)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data00000010.h5", "data00000015.h5"]


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("points", [(16,), (2, 5)])
def test_any_ranks_write_the_same_data(points: tuple[int, ...]) -> None:
    from hpcpic.core.comm.world import World

    world = World.start()
    made = tempfile.mkdtemp() if world.rank == 0 else ""
    path = write(world, Path(world.bcast(made.encode()).decode()), points)
    assert_holds(path, points)
