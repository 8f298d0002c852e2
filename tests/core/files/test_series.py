"""The series holds every row that was flushed, bit for bit, in both files."""

import time
from pathlib import Path

import numpy as np
import pytest
from series_table import read_csv

from hpcpic.core.errors import FileError
from hpcpic.core.files import series
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter, read_series

UNITS = {"energy": "J", "charge": "C"}


def row(step: int) -> dict[str, float]:
    return {"energy": np.sin(step) * 10.0 ** (step % 600 - 300), "charge": -1.0 / (step + 3)}


def fill(writer: SeriesWriter, steps: range, every: int = 7) -> None:
    for step in steps:
        writer.append(step, step * 0.1, row(step))
        if step % every == 0:
            writer.flush()
    writer.flush()


def assert_rows(folder: Path, steps: list[int]) -> None:
    for found in (read_series(folder), read_csv(folder / "series.csv")):
        assert found.step.tolist() == steps
        assert found.time.tolist() == [step * 0.1 for step in steps]
        assert found.units == UNITS
        for name in UNITS:
            assert found[name].tolist() == [row(step)[name] for step in steps]


def test_both_files_hold_every_row_exactly(tmp_path: Path) -> None:
    fill(SeriesWriter(RunDir(tmp_path), UNITS), range(1300))  # more than two chunks
    assert_rows(tmp_path, list(range(1300)))
    lines = (tmp_path / "series.csv").read_text().splitlines()
    assert lines[:2] == ["step,time,energy,charge", f"0,0.0,{','.join(str(float(v)) for v in row(0).values())}"]
    units = (tmp_path / "series.units.csv").read_text().splitlines()
    assert units == ["name,unit", "step,1", "time,s", "energy,J", "charge,C"]


def test_a_restart_makes_the_table_anew_of_one_with_units_in_the_second_row(tmp_path: Path) -> None:
    """As older versions wrote them."""
    fill(SeriesWriter(RunDir(tmp_path), UNITS), range(20))
    path = tmp_path / "series.csv"
    names, *rows = path.read_text().splitlines(keepends=True)
    path.write_text("".join([names, "1,s,J,C\n", *rows]))
    (tmp_path / "series.units.csv").unlink()
    fill(SeriesWriter(RunDir(tmp_path), UNITS, after=9), range(10, 30))
    assert_rows(tmp_path, list(range(30)))
    assert path.read_text().splitlines()[1].startswith("0,0.0,")


def test_any_reader_of_tables_takes_the_series_as_numbers(tmp_path: Path) -> None:
    fill(SeriesWriter(RunDir(tmp_path), UNITS), range(20))
    table = np.genfromtxt(tmp_path / "series.csv", delimiter=",", names=True)
    assert table["energy"].mean() == np.mean([row(step)["energy"] for step in range(20)])


def test_pandas_reads_the_series_at_once(tmp_path: Path) -> None:
    """Names from the first row, steps as integers, all else as floating point; units by name."""
    pandas = pytest.importorskip("pandas")
    fill(SeriesWriter(RunDir(tmp_path), UNITS), range(20))
    table = pandas.read_csv(tmp_path / "series.csv")
    assert dict(table.dtypes.astype(str)) == {"step": "int64", "time": "float64", **dict.fromkeys(UNITS, "float64")}
    assert all(table[name].tolist() == pytest.approx([row(k)[name] for k in range(20)], rel=1e-15) for name in UNITS)
    units = pandas.read_csv(tmp_path / "series.units.csv", index_col="name")["unit"]
    assert dict(units) == {"step": "1", "time": "s", **UNITS}


def test_it_is_ordinary_hdf5_with_units(tmp_path: Path) -> None:
    import h5py

    fill(SeriesWriter(RunDir(tmp_path), UNITS), range(10))
    with h5py.File(tmp_path / "series.h5", "r") as file:
        assert {name: file[name].attrs["units"] for name in file} == {"step": "1", "time": "s", **UNITS}
        assert all(file[name].shape == (10,) for name in file)


def test_an_empty_series_can_be_read(tmp_path: Path) -> None:
    SeriesWriter(RunDir(tmp_path), UNITS)
    assert_rows(tmp_path, [])


@pytest.mark.parametrize("after", [-1, 0, 41, 99, 1000])
def test_a_restart_drops_what_came_later(tmp_path: Path, after: int) -> None:
    fill(SeriesWriter(RunDir(tmp_path), UNITS), range(100))
    kept = min(after, 99)
    fill(SeriesWriter(RunDir(tmp_path), UNITS, after=after), range(kept + 1, 150))
    assert_rows(tmp_path, list(range(150)))


def test_observers_may_change_at_a_restart(tmp_path: Path) -> None:
    fill(SeriesWriter(RunDir(tmp_path), UNITS), range(3))
    writer = SeriesWriter(RunDir(tmp_path), {"energy": "J", "new": "m"}, after=1)
    writer.append(2, 0.2, {"energy": 5.0, "new": 6.0})
    writer.flush()
    found = read_series(tmp_path)
    assert found.units == {**UNITS, "new": "m"}
    assert found["energy"].tolist() == [row(0)["energy"], row(1)["energy"], 5.0]
    assert np.array_equal(found["charge"], [row(0)["charge"], row(1)["charge"], np.nan], equal_nan=True)
    assert np.array_equal(found["new"], [np.nan, np.nan, 6.0], equal_nan=True)


def test_rows_are_due_after_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = SeriesWriter(RunDir(tmp_path), UNITS)
    now = time.monotonic()
    monkeypatch.setattr(series.clock, "monotonic", lambda: now + 1)
    writer.append(0, 0.0, row(0))
    assert not writer.due
    monkeypatch.setattr(series.clock, "monotonic", lambda: now + 10)
    writer.append(1, 0.1, row(1))
    assert writer.due
    writer.flush()
    assert not writer.due
    assert_rows(tmp_path, [0, 1])


@pytest.mark.parametrize("name", ["series.h5", "series.csv"])
def test_a_file_that_was_taken_away_is_a_file_error(tmp_path: Path, name: str) -> None:
    writer = SeriesWriter(RunDir(tmp_path), UNITS)
    writer.append(0, 0.0, row(0))
    (tmp_path / name).unlink()
    with pytest.raises(FileError, match=rf"cannot append to .*{name}: No such file"):
        writer.flush()


def test_a_damaged_series_is_a_file_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"series.h5: no such file"):
        read_series(tmp_path)
    (tmp_path / "series.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(FileError, match=r"series.h5: cannot be read"):
        read_series(tmp_path)
