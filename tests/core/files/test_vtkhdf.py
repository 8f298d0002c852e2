"""Every snapshot is read back exactly, by VTK (so ParaView) and by our reader, for any cut among ranks."""

import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from hpcpic.core.errors import FileError
from hpcpic.core.files import image, snapshot
from hpcpic.core.files.arrays import FieldArray, ParticleArray, spatial
from hpcpic.core.files.reader import Fields, Particles, open_run
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.snapshot import FieldsWriter, ParticlesWriter
from hpcpic.core.files.together import ALONE
from hpcpic.core.space.domain import Domain, block_ranges

GRIDS = [(16,), (6, 5), (4, 5, 3), (1, 5), (5, 1)]
COUNTS = [10, 2000, 5, 0, 3000, 1024, 1]


def domain(points: tuple[int, ...], cuts: tuple[int, ...] | None = None) -> Domain:
    lengths = tuple(n * 0.25 * (axis + 1) for axis, n in enumerate(points))
    return Domain(lengths, points, (True,) * len(points), cuts or (0, points[0]))


def fields(points: tuple[int, ...], step: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(step)
    return {"rho": rng.standard_normal(points), "E": rng.standard_normal((*points, 2)).astype(np.float32)}


def particles(step: int) -> dict[str, dict[str, np.ndarray]]:
    rng = np.random.default_rng(step)

    def species(n: int) -> dict[str, np.ndarray]:
        return {
            "id": rng.permutation(n),
            "position": rng.standard_normal((n, 3)),
            "velocity": rng.standard_normal((n, 3)),
            "charge": rng.standard_normal(n).astype(np.float32),
        }

    return {"ions": species(COUNTS[step % 7]), "electrons": species(COUNTS[step % 7] // 2)}


def handed(arrays: dict[str, dict[str, np.ndarray]], rank: int = 0, ranks: int = 1) -> dict[str, ParticleArray]:
    """What one rank has of it."""
    result = {}
    for name, columns in arrays.items():
        low, high = block_ranges(len(columns["id"]), ranks)[rank]
        own = {key: values[low:high] for key, values in columns.items()}
        result[name] = ParticleArray(
            own.pop("id"), own.pop("position"), own, {"velocity": "m/s", "charge": "C"}, {"velocity": -0.05}
        )
    return result


def write_fields(
    path: Path, points: tuple[int, ...], steps: range, after: int | None = None, time_share: float = 1.0
) -> None:
    writer = FieldsWriter(ALONE, path, after, time_share)
    for step in steps:
        arrays = fields(points, step)
        given = {name: FieldArray(arrays[name].copy(), unit) for name, unit in (("rho", "C/m2"), ("E", "V/m"))}
        writer.append(10 * step, 0.1 * step, domain(points), given)
        for field in given.values():
            field.values[...] = np.nan  # as the run goes on with its arrays
    writer.flush()


def write_particles(path: Path, steps: range, after: int | None = None, time_share: float = 1.0) -> None:
    writer = ParticlesWriter(ALONE, path, after, time_share)
    for step in steps:
        writer.append(10 * step, 0.1 * step, handed(particles(step)))
    writer.flush()


def vtk_steps(path: Path) -> list[tuple[float, object, dict[str, np.ndarray]]]:
    """(time, data set, point arrays) of every step, as VTK sees them."""
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    steps = []
    for number in range(reader.GetNumberOfSteps()):
        reader.SetStep(number)
        reader.Update()
        seen = reader.GetOutputDataObject(0)
        kept = seen.NewInstance()
        kept.DeepCopy(seen)
        data = kept.GetPointData()
        arrays = [data.GetArray(k) for k in range(data.GetNumberOfArrays())]
        steps.append((reader.GetTimeValue(), kept, {array.GetName(): vtk_to_numpy(array) for array in arrays}))
    return steps


def assert_fields(path: Path, points: tuple[int, ...], count: int) -> None:
    snapshots = Fields(path)
    assert snapshots.steps.tolist() == [10 * step for step in range(count)]
    assert snapshots.times.tolist() == [0.1 * step for step in range(count)]
    assert snapshots.units == {"E": "V/m", "rho": "C/m2"}
    for step in range(count):
        for name, values in fields(points, step).items():
            found = snapshots.read(name, step)
            assert found.dtype == values.dtype and np.array_equal(found, values.squeeze())


def assert_particles(path: Path, count: int) -> None:
    snapshots = Particles(path)
    assert snapshots.steps.tolist() == [10 * step for step in range(count)]
    assert snapshots.species == ["ions", "electrons"] and snapshots.units["charge"] == "C"
    assert (snapshots.time_offsets["velocity"], snapshots.time_offsets["charge"]) == (-0.05, 0.0)
    for step in range(count):
        for name, columns in particles(step).items():
            order = np.argsort(columns["id"])
            found = snapshots.read(name, step)
            assert set(found) == set(columns)
            for key, values in columns.items():
                assert found[key].dtype == values.dtype and np.array_equal(found[key], values[order]), key


@pytest.mark.parametrize("points", GRIDS)
@pytest.mark.parametrize("chunk", [snapshot.CHUNK_BYTES, 64])
def test_vtk_and_reader_see_the_fields_of_every_step(
    tmp_path: Path, points: tuple[int, ...], chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(snapshot, "CHUNK_BYTES", chunk)
    path = tmp_path / "fields.vtkhdf"
    write_fields(path, points, range(5))
    assert_fields(path, points, 5)
    seen = vtk_steps(path)
    assert [time for time, *_ in seen] == [0.1 * step for step in range(5)]
    box = domain(points)
    for step, (_, grid, arrays) in enumerate(seen):
        assert grid.GetDimensions() == (*points[::-1], 1, 1)[:3]
        assert grid.GetSpacing() == (*box.spacing[::-1], 1.0, 1.0)[:3] and grid.GetOrigin() == (0, 0, 0)
        expected = fields(points, step)
        assert np.array_equal(arrays["rho"], expected["rho"].ravel())
        assert np.array_equal(arrays["E"], spatial(expected["E"].reshape(-1, 2)))


@pytest.mark.parametrize("chunk", [snapshot.CHUNK_BYTES, 999])
def test_vtk_and_reader_see_the_particles_of_every_step(
    tmp_path: Path, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from vtk.util.numpy_support import vtk_to_numpy

    monkeypatch.setattr(snapshot, "CHUNK_BYTES", chunk)
    path = tmp_path / "particles.vtkhdf"
    write_particles(path, range(len(COUNTS)))
    assert_particles(path, len(COUNTS))
    seen = vtk_steps(path)
    assert len(seen) == len(COUNTS)
    for step, (at, cloud, arrays) in enumerate(seen):
        sets = list(particles(step).values())
        n = sum(len(columns["id"]) for columns in sets)
        assert at == 0.1 * step and cloud.GetNumberOfPoints() == cloud.GetNumberOfVerts() == n
        if n == 0:
            continue
        for name in ("id", "velocity", "charge"):
            assert np.array_equal(arrays[name], np.concatenate([columns[name] for columns in sets]))
        assert np.array_equal(arrays["species"], np.repeat([0, 1], [len(columns["id"]) for columns in sets]))
        points = vtk_to_numpy(cloud.GetPoints().GetData())
        assert np.array_equal(points, np.concatenate([columns["position"] for columns in sets]))
        assert np.array_equal(vtk_to_numpy(cloud.GetVerts().GetConnectivityArray()), np.arange(n))
        assert np.array_equal(vtk_to_numpy(cloud.GetVerts().GetOffsetsArray()), np.arange(n + 1))


WAITING = 1e-9  # share of the time for writing: nothing is written before the first `flush`


@pytest.mark.parametrize("points", GRIDS)
def test_snapshots_that_wait_for_each_other_are_the_same_in_the_end(
    tmp_path: Path, points: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Written together, at a restart too, they give what snapshots give that are written one by one; the table of steps
    gets a second chunk meanwhile.
    """
    monkeypatch.setattr(snapshot, "STEPS_PER_CHUNK", 16)
    one, many = tmp_path / "one.vtkhdf", tmp_path / "many.vtkhdf"
    for path, share in ((one, 1.0), (many, WAITING)):
        write_fields(path, points, range(12), time_share=share)
        write_fields(path, points, range(9, 22), after=89, time_share=share)
        assert_fields(path, points, 22)
    assert one.stat().st_size == many.stat().st_size
    sets = tmp_path / "particles.vtkhdf"
    write_particles(sets, range(5), time_share=WAITING)
    write_particles(sets, range(4, 12), after=30, time_share=WAITING)
    assert_particles(sets, 12)
    assert [cloud.GetNumberOfVerts() for _, cloud, _ in vtk_steps(sets)] == [
        COUNTS[k % 7] + COUNTS[k % 7] // 2 for k in range(12)
    ]


def test_small_snapshots_wait_only_as_long_as_writing_is_dear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first is there at once; while the clock stands still the others wait; none waits for a later one for long."""
    now = [0.0]
    monkeypatch.setattr(snapshot.clock, "monotonic", lambda: now[0])
    path = tmp_path / "fields.vtkhdf"
    writer = FieldsWriter(ALONE, path, time_share=0.02)
    real = image.append

    def slow(*arguments: object) -> None:
        real(*arguments)  # type: ignore[arg-type]
        now[0] += 0.01

    monkeypatch.setattr(image, "append", slow)
    seen = []
    for step in range(8):
        given = {"rho": FieldArray(np.full((6, 5), float(step)))}
        writer.append(step, 0.1 * step, domain((6, 5)), given)
        seen.append(len(Fields(path).steps))
        now[0] += 0.2
    assert seen == [1, 1, 1, 4, 4, 4, 7, 7]  # 0.01 s of writing every 0.5 s, at the next snapshot
    big = {"rho": FieldArray(np.zeros((6, 5)))}
    monkeypatch.setattr(snapshot, "BUFFER_BYTES", 2 * 240)
    writer.append(8, 0.8, domain((6, 5)), big)
    assert len(Fields(path).steps) == 9


@pytest.mark.parametrize("after", [-1, 0, 20, 45])
def test_a_restart_gives_the_file_of_the_uninterrupted_run(tmp_path: Path, after: int) -> None:
    count = after // 10 + 1
    for stop in (5, 7):  # the restarted run writes fewer, or more, steps than were dropped
        path = tmp_path / f"fields{stop}.vtkhdf"
        write_fields(path, (6, 5), range(5))
        write_fields(path, (6, 5), range(count, stop), after=after)
        assert_fields(path, (6, 5), stop)
        assert len(vtk_steps(path)) == stop
        path = tmp_path / f"particles{stop}.vtkhdf"
        write_particles(path, range(5))
        write_particles(path, range(count, stop), after=after)
        assert_particles(path, stop)
        assert [cloud.GetNumberOfPoints() for _, cloud, _ in vtk_steps(path)] == [n + n // 2 for n in COUNTS[:stop]]


def test_space_that_a_killed_writer_allocated_is_given_back(tmp_path: Path) -> None:
    write_fields(tmp_path / "killed.vtkhdf", (6, 5), range(2))
    write_fields(tmp_path / "whole.vtkhdf", (6, 5), range(2))
    with open(tmp_path / "killed.vtkhdf", "ab") as file:
        file.write(b"x" * 100_000)
    for name in ("killed.vtkhdf", "whole.vtkhdf"):
        write_fields(tmp_path / name, (6, 5), range(2, 4), after=10)
    assert (tmp_path / "killed.vtkhdf").read_bytes() == (tmp_path / "whole.vtkhdf").read_bytes()


def test_a_restart_without_a_file_begins_one(tmp_path: Path) -> None:
    write_fields(tmp_path / "fields.vtkhdf", (16,), range(2), after=3)
    assert_fields(tmp_path / "fields.vtkhdf", (16,), 2)


def test_a_damaged_file_is_a_file_error_at_the_restart(tmp_path: Path) -> None:
    path = tmp_path / "fields.vtkhdf"
    write_fields(path, (6, 5), range(2))
    content = path.read_bytes()
    with h5py.File(path, "r+") as file:
        del file["VTKHDF/Steps"]
    for damaged in (path.read_bytes(), content[:100], b""):
        path.write_bytes(damaged)
        with pytest.raises(FileError, match=r"cannot take up .*fields.vtkhdf"):
            FieldsWriter(ALONE, path, after=10)


def test_other_arrays_go_on_in_the_next_file_and_are_read_as_one(tmp_path: Path) -> None:
    path = tmp_path / "fields.vtkhdf"
    write_fields(path, (6, 5), range(2))
    before = path.read_bytes()
    rho, e = fields((6, 5), 7).values()
    for step, arrays in [(20, {"rho": rho}), (30, {"rho": rho.astype(np.float32), "E": e}), (40, {"rho": rho})]:
        writer = FieldsWriter(ALONE, path, after=step - 1)
        writer.append(step, 0.01 * step, domain((6, 5)), {name: FieldArray(values) for name, values in arrays.items()})
    assert path.read_bytes() == before
    found = Fields(path)
    assert found.steps.tolist() == [0, 10, 20, 30, 40] and found.names == ("rho",) and found.names_at(0) == ("E", "rho")
    assert np.array_equal(found.read("rho", 1), fields((6, 5), 1)["rho"]) and np.array_equal(found.read("rho", 4), rho)
    assert found.index(name="E") == 3 and found.index(time=0.19, name="E") == 1 and found.index(time=0.2) == 2
    with pytest.raises(FileError, match=r"no E at step 40; there are 0, 10, 30"):
        found.index(40, name="E")
    write_fields(path, (6, 5), range(2, 3), after=10)  # from a checkpoint before the other arrays
    assert Fields(path).steps.tolist() == [0, 10, 20]


def test_other_columns_of_particles_go_on_in_the_next_file(tmp_path: Path) -> None:
    path = tmp_path / "particles.vtkhdf"
    write_particles(path, range(2))
    bare = {name: ParticleArray(own.ids, own.position) for name, own in handed(particles(2)).items()}
    ParticlesWriter(ALONE, path, after=10).append(20, 0.2, bare)
    found = Particles(path)
    assert found.steps.tolist() == [0, 10, 20]
    assert set(found.read("ions", 2)) == {"id", "position"} and "velocity" in found.read("ions", 1)
    assert len(found.positions(["ions", "electrons"], 2)) == sum(len(own.ids) for own in bare.values())


def test_other_grids_are_refused_and_the_file_kept(tmp_path: Path) -> None:
    path = tmp_path / "fields.vtkhdf"
    write_fields(path, (6, 5), range(2))
    before = path.read_bytes()
    with pytest.raises(FileError, match=r"a grid of \(6, 5\) points, this run has \(7, 5\)"):
        write_fields(path, (7, 5), range(9, 10), after=100)
    assert path.read_bytes() == before
    species = handed(particles(0))
    species["ions"] = ParticleArray(np.arange(1), np.zeros((1, 3)))
    with pytest.raises(FileError, match="has the columns"):
        ParticlesWriter(ALONE, tmp_path / "particles.vtkhdf").append(0, 0.0, species)


def test_a_failed_append_leaves_the_file_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "fields.vtkhdf"
    write_fields(path, (6, 5), range(3))
    before = path.read_bytes()

    def fail(*arguments: object) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(image, "write_shards", fail)
        with pytest.raises(FileError, match=r"cannot append to .*fields.vtkhdf: Input/output error"):
            write_fields(path, (6, 5), range(3, 4), after=100)
    assert path.read_bytes() == before
    write_fields(path, (6, 5), range(3, 6), after=100)
    assert_fields(path, (6, 5), 6)


def test_the_same_steps_give_the_same_bytes(tmp_path: Path) -> None:
    for run in ("a", "b"):
        write_fields(tmp_path / f"{run}.fields", (6, 5), range(2))
        write_particles(tmp_path / f"{run}.particles", range(2))
        time.sleep(1.01)  # HDF5 knows whole seconds
    for kind in ("fields", "particles"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_units_and_names_of_species_are_attributes(tmp_path: Path) -> None:
    write_particles(tmp_path / "p.vtkhdf", range(1))
    with h5py.File(tmp_path / "p.vtkhdf", "r") as file:
        data = file["VTKHDF/PointData"]
        assert list(data["species"].attrs["names"]) == ["ions", "electrons"]
        assert data["velocity"].attrs["units"] == "m/s" and file["VTKHDF/Points"].attrs["units"] == "m"


def test_a_run_is_arrays(tmp_path: Path) -> None:
    rundir = RunDir.create(tmp_path / "run", config="a = 1;", facts={"steps": 3})
    write_fields(rundir.fields, (6, 5), range(3))
    write_particles(rundir.particles, range(3))
    run = open_run(rundir.path)
    assert run.config == "a = 1;" and run.summary["steps"] == 3
    assert np.array_equal(run.field("rho"), fields((6, 5), 2)["rho"])
    assert np.array_equal(run.field("rho", step=10), fields((6, 5), 1)["rho"])
    assert np.array_equal(run.field("rho", time=0.06), fields((6, 5), 1)["rho"])
    assert run.fields(["rho"], [0, 20])["rho"].shape == (2, 6, 5) and set(run.fields()) == {"rho", "E"}
    assert run.field_snapshots.spacing == domain((6, 5)).spacing
    assert len(run.particles("electrons", step=10)["id"]) == COUNTS[1] // 2
    for ask, why in [
        (lambda: run.field("phi"), "no array phi; there are E, rho"),
        (lambda: run.field("rho", step=5), "no step 5; there are 0, 10, 20"),
        (lambda: run.particles("dust"), "no species dust; there are ions, electrons"),
        (lambda: run.histogram("fv"), "no histograms.h5: the run has none; `histogram` of its case asks for them"),
        (lambda: run.series, r"series.h5: no such file yet: the run has not come to its first sample"),
    ]:
        with pytest.raises(FileError, match=why):
            ask()


def common_folder(world) -> Path:
    made = tempfile.mkdtemp() if world.rank == 0 else ""
    return Path(world.bcast(made.encode()).decode())


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("points", [(16,), (6, 5), (3, 2)])
def test_ranks_write_the_file_of_one_rank(points: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    from hpcpic.core.comm.world import World

    monkeypatch.setattr(snapshot, "CHUNK_BYTES", 64)
    world, rows = World.start(), points[0]
    folder = common_folder(world)
    path = folder / "fields.vtkhdf"
    writer = FieldsWriter(world, path)
    for step in range(4):
        first = (step * rows) // 3  # the first rank's slab grows from empty to everything
        cuts = (0, first, *(rows for _ in range(world.size - 1)))
        low, high = cuts[world.rank], cuts[world.rank + 1]
        given = {
            name: FieldArray(values[low:high], unit)
            for (name, values), unit in zip(fields(points, step).items(), ("C/m2", "V/m"), strict=True)
        }
        writer.append(10 * step, 0.1 * step, domain(points, cuts), given)
    assert_fields(path, points, 4)
    if world.rank == 0:
        write_fields(folder / "single.vtkhdf", points, range(4))
        assert (folder / "single.vtkhdf").read_bytes() == path.read_bytes()
    world.barrier()


@pytest.mark.mpi(min_size=2)
def test_particles_of_all_ranks_are_there_and_a_failing_rank_fails_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from hpcpic.core.comm.world import World

    world = World.start()
    path = common_folder(world) / "particles.vtkhdf"
    writer = ParticlesWriter(world, path)
    for step in range(4):
        writer.append(10 * step, 0.1 * step, handed(particles(step), world.rank, world.size))

    def fail(*arguments: object) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        if world.rank == world.size - 1:
            patch.setattr(image, "write_all", fail)
        with pytest.raises(FileError, match=rf"Input/output error \(rank {world.size - 1}\)"):
            writer.append(40, 0.4, handed(particles(4), world.rank, world.size))
    world.barrier()
    assert_particles(path, 4)
    world.barrier()
    for step in range(4, 7):
        writer.append(10 * step, 0.1 * step, handed(particles(step), world.rank, world.size))
    assert_particles(path, 7)


FLAT = [((6, 1), (6, 1)), ((1, 6), (6,)), ((1, 1), (1,)), ((6,), (6,)), ((2, 1, 3), (2, 1, 3))]


@pytest.mark.parametrize("points, grid", FLAT)
def test_axes_of_one_point_are_left_out_of_arrays_and_known(tmp_path, points, grid):
    write_fields(tmp_path / "fields.vtkhdf", points, range(1))
    found = Fields(tmp_path / "fields.vtkhdf")
    assert found.grid == (grid, domain(points).spacing[len(points) - len(grid) :])
    assert found.points == tuple(n for n in points if n > 1) and len(found.spacing) == len(found.points)
