"""The field beside a quantity: the same for any resolution and for particles, and it sees what a sum hides."""

from types import SimpleNamespace

import numpy as np
import pytest

from hpcpic.core.app.knobs import Seen
from hpcpic.core.study.field import of_nodes, of_particles

SEEN = Seen("u", (0.0, 0.0), (2.0, 1.0), (96, 48), lambda time: ())


def on_nodes(function, nx, ny):
    """Nodes half a spacing inside the box, stored with y first."""
    dx, dy = 2.0 / nx, 1.0 / ny
    x, y = (np.arange(nx) + 0.5) * dx, (np.arange(ny) + 0.5) * dy
    fields = SimpleNamespace(points=(ny, nx), spacing=(dy, dx), first=(0.5 * dy, 0.5 * dx))
    values = function(x[None, :], y[:, None])
    return of_nodes(SimpleNamespace(field_snapshots=fields, field=lambda name: values), SEEN)


def wave(x, y):
    return np.sin(np.pi * x) * y + 0.0 * x


def test_it_is_the_same_for_any_number_of_nodes():
    fine = on_nodes(wave, 192, 96)
    errors = [np.abs(on_nodes(wave, n, n // 2) - fine).max() for n in (24, 48, 96)]
    assert errors[0] < 0.02 * np.abs(fine).max() and errors[0] > 3.0 * errors[1] > 9.0 * errors[2]  # second order


def test_particles_on_the_nodes_show_the_same_up_to_the_volume():
    n, m = 96, 48
    x, y = np.meshgrid((np.arange(n) + 0.5) * 2.0 / n, (np.arange(m) + 0.5) / m)
    columns = {"position": np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1), "u": wave(x, y).ravel()}
    run = SimpleNamespace(particle_snapshots=SimpleNamespace(species=["a"]), particles=lambda species: columns)
    of_both = np.sort(2.0 * of_particles(run, SEEN)), np.sort(on_nodes(wave, n, m))  # axes in another order
    assert of_both[0] == pytest.approx(of_both[1], abs=1e-12)


def test_it_sees_errors_that_cancel_in_the_sum():
    right, wrong = on_nodes(lambda x, y: y + 0.0 * x, 96, 48), on_nodes(lambda x, y: (1.0 - y) + 0.0 * x, 96, 48)
    assert right.sum() == pytest.approx(wrong.sum(), rel=1e-12)
    assert np.linalg.norm(right - wrong) > 0.5 * np.linalg.norm(right)
