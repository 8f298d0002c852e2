"""Tile parts cover the grid once; pages are found for everybody."""

import numpy as np
import pytest

from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.tasks.arena import Arena
from hpcpic.plasma.particles.arrays import declared
from hpcpic.plasma.particles.pages import Pages
from hpcpic.plasma.particles.tiles import Tiles
from hpcpic.plasma.sizes import EDGE


@pytest.mark.parametrize(
    "points", [(1, 7), (8, 1), (9, 9), (97, 101), (16, 32), (5,), (256,), (700,), (1, 2, 3), (9, 17, 5)]
)
@pytest.mark.parametrize("ranks", [1, 2, 3])
@pytest.mark.parametrize("blocks", [1, 4, 9])
def test_parts_of_all_ranks_cover_every_cell_once(points, ranks, blocks):
    domain = Domain(tuple(map(float, points)), points, (True,) * len(points), even_cuts(points[0], ranks))
    edge, seen = EDGE[len(points)], np.zeros((1,) * (3 - len(points)) + points, int)
    for rank in range(ranks):
        tiles = Tiles(domain, rank, blocks)
        assert [a for a, _ in tiles.ranges[1:]] == [b for _, b in tiles.ranges[:-1]]
        for part, (_, row, column, r0, r1, c0, c1, block, *above) in enumerate(tiles.parts):
            plane, p0, p1 = above or (0, 0, 1)
            assert row % edge == column % edge == plane % edge == 0
            assert tiles.ranges[block][0] <= part < tiles.ranges[block][1]
            cells = np.s_[plane + p0 : plane + p1, row + r0 : row + r1, column + c0 : column + c1]
            seen[cells] += 1
            rows = tiles.row_part[cells[1]][None, :, None]
            if above:
                rows = rows + tiles.row_part[tiles.points[0] :][cells[0]][:, None, None]
            found = tiles.column_part[cells[2]] + rows * tiles.column_stride[cells[2]]
            assert (found == part).all()
    assert (seen == 1).all()


def test_every_block_gets_the_pages_it_needs():
    sizes = {"pages": 8, "packs": 16, "components": 4, "lanes": 8, "slots": 4, "blocks": 3, "boxes": 4, "box_size": 9,
             "list_length": 16, "field_scratch": 8, "charge_scratch": 8, "species": 1, "moments": 1, "axes": 2,
             "record_numbers": 8, "records": 0, "record_bytes": 40}  # fmt: skip
    arena = Arena(declared("float64"), **sizes)
    pages = Pages(arena)
    for wanted in ([3, 0, 2], [0, 9, 0], [40, 1, 1]):
        pages.need(wanted)
        assert (arena["counters"][:3, 0] >= wanted).all()
        stacks = [arena["free"][b, : arena["counters"][b, 0]] for b in range(3)]
        held = np.concatenate(stacks)
        assert len(set(held)) == len(held) == pages.fresh  # none twice, none lost
        assert held.max() < arena.sizes["pages"]
