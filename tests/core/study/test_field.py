"""The field beside a quantity: the same for any resolution and for particles, and it sees what a sum hides."""

from dataclasses import replace
from types import SimpleNamespace

import error_app
import numpy as np
import pytest
from test_tradeoff import found, program  # noqa: F401  (program: a fixture)

from hpcpic.core.app.knobs import Seen
from hpcpic.core.study.field import of_nodes, of_particles
from hpcpic.core.study.search import Search

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


@pytest.mark.parametrize(
    "words, at_case, code",
    [((), 14.0, 3), ((), 0.5, 0), (("--qoi", "answer"), 14.0, 0)],
    ids=["lost", "kept by the case", "asked for"],
)
def test_nothing_is_certified_whose_field_is_lost_unless_the_user_named_the_quantity(
    program,  # noqa: F811
    tmp_path,
    monkeypatch,
    words,
    at_case,
    code,
):
    """The error of the answer is small whatever the field: of the energy of a plasma whose wave drowns in noise."""
    seen = Seen("E", (0.0,), (1.0,), (16,), lambda time: ())
    app = replace(error_app.APP, knobs=lambda config: replace(error_app.knobs(config), seen=seen))
    monkeypatch.setattr(error_app, "APP", app)
    monkeypatch.setattr(Search, "field_of", lambda self, pilot: None)
    monkeypatch.setattr(Search, "field_error", lambda self, pilot: at_case if pilot is self.base else 14.0)
    done = program("tradeoff", "-o", "out", "--tolerance", "1%", "--write", "new.conf", *words)
    best = found(tmp_path)["recommended"]
    assert (done.returncode, best["certified"]) == (code, code == 0), done.stdout + done.stderr
    assert ("the field E at the end is off by 1400 %" in done.stderr) or at_case < 1.0
    assert (best["sizes"]["dx"] == 0.1) == (at_case < 1.0)  # the case itself, where it has the field
    assert ("NOT certified" in done.stdout) == ("not certified" in (tmp_path / "new.conf").read_text()) == bool(code)
