import numpy as np

from hpcpic.core.files.arrays import ParticleArray
from hpcpic.core.run.worst import SHOWN, worst_nodes, worst_particles


def test_particles_that_are_no_number_come_first_then_the_fastest():
    n = 30
    x, v = np.zeros((n, 3)), np.zeros((n, 3))
    v[:, 0] = np.arange(n)
    v[3, 1], x[7, 2] = np.inf, np.nan
    density = np.full(n, 990.0)
    some = ParticleArray(np.arange(n) + 100, x, {"velocity": v.astype(np.float32), "density": density})
    lines = worst_particles({"water": some, "rest": ParticleArray(np.zeros(1, np.int64), x[:1], {"velocity": v[:1]})})
    assert len(lines) == SHOWN
    assert lines[0].startswith("water 103 at (0, 0, 0) m") and lines[1].startswith("water 107 at (0, 0, nan) m")
    assert [line.split()[1] for line in lines[2:5]] == ["129", "128", "127"] and "density 990 kg/m3" in lines[2]
    assert worst_particles({}) == []


def test_nodes_are_told_by_their_place_on_the_whole_grid():
    rho, u = np.ones((3, 4)), np.zeros((3, 4, 2))
    u[2, 1], rho[0, 3] = (0.6, 0.8), np.nan
    lines = worst_nodes(rho, u, first_row=10)
    assert lines[0].startswith("node (3, 10), density nan") and lines[1].startswith("node (1, 12), density 1 of rest")
