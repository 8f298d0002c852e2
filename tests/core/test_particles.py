import numpy as np

from hpcpic.core.space.particles import pack_rows, record_type, unpack_rows


def test_records_carry_every_bit():
    ids = np.arange(10)
    v = np.stack([ids, ids + 1, ids + 2], 1) / 7
    v[3] = [np.nan, -0.0, np.inf]
    columns = {"id": ids, "x": v[:, :2].astype(np.float32), "v": v, "cell": ids.astype(np.int16)}
    layout = record_type(columns)
    assert layout.itemsize == 8 + 2 * 4 + 3 * 8 + 2
    for index in (np.array([7, 3]), np.zeros(0, np.int64), slice(2, 5)):
        records = pack_rows(columns, index)
        assert records.dtype == np.uint8 and records.shape == (len(ids[index]), layout.itemsize)
        for name, column in unpack_rows(records, layout).items():
            assert column.dtype == columns[name].dtype and column.tobytes() == columns[name][index].tobytes()
