"""What corrections of section 2 of Minatti & Pasculli buy: errors of values and gradients, inside and at a surface."""

import numpy as np
import pytest

from sph.physics.smoothing import SMOOTHING

DP, H, KERNEL = 0.05, 0.065, SMOOTHING["wendland2"]


def disordered(seed=1):
    """x[n, 2] around the middle of the lower edge of water below y = 0.5, off its lattice by up to a fifth of dp."""
    lines = (np.arange(20) + 0.5) * DP
    x = np.stack(np.meshgrid(lines, lines[:10], indexing="ij"), axis=-1).reshape(-1, 2)
    return x + 0.2 * DP * np.random.default_rng(seed).uniform(-1, 1, x.shape)


class Estimates:
    """Values[n] and gradients[n, 2] of a field f[n] at all particles, by name; r[i, j] = x_i - x_j over h."""

    def __init__(self, x):
        self.r = (x[:, None] - x[None]) / H
        q, volume = np.sqrt(np.sum(self.r**2, axis=2)), DP**2 / H**2
        self.w = volume * KERNEL.value(q, 2)
        self.f = volume * KERNEL.gradient(q, 2) * (q > 0.0)
        self.slopes = self.f[..., None] * self.r  # grad W V, over 1 / h
        self.basis = np.concatenate([np.ones((*q.shape, 1)), -self.r], axis=2)  # 1 and x_j - x_i
        self.around = np.sum(q < KERNEL.support, axis=1)

    def values(self, f):
        linear = np.einsum("ij,ija,ijb->iab", self.w, self.basis, self.basis)
        taylor = self.taylor_matrix()
        return {
            "(MP 10)": self.w @ f,
            "Shepard's mean": self.w @ f / self.w.sum(axis=1),
            "RKPM, linear": solved(linear, np.einsum("ij,ija,j->ia", self.w, self.basis, f))[:, 0],
            "Liu & Liu": solved(taylor, self.taylor_sums(f))[:, 0],
        }

    def gradients(self, f):
        steps = f[None] - f[:, None]
        plain = np.einsum("ija,ij->ia", self.slopes, steps)
        linear = np.einsum("ij,ija,ijb->iab", self.w, self.basis, self.basis)
        found = {
            "(MP 11)": np.einsum("ija,j->ia", self.slopes, f),
            "differences, as in (MP 16)": plain,
            "gradient_correction": solved(self.moments(), plain),
            "RKPM, linear": solved(linear, np.einsum("ij,ija,j->ia", self.w, self.basis, f))[:, 1:],
            "Liu & Liu": solved(self.taylor_matrix(), self.taylor_sums(f))[:, 1:],
            "Liu & Liu, f_i known": solved(self.taylor_matrix()[:, 1:, 1:], plain),
        }
        return {name: gradient / H for name, gradient in found.items()}

    def moments(self):
        """m'_1 of (MP 13)."""
        return -np.einsum("ij,ija,ijb->iab", self.f, self.r, self.r)

    def taylor_matrix(self):
        """f_j = f_i + (x_j - x_i) grad f, summed with V W and with V grad W (Liu & Liu 2006)."""
        weights = np.concatenate([self.w[..., None], self.slopes], axis=2)
        return np.einsum("ija,ijb->iab", weights, self.basis)

    def taylor_sums(self, f):
        return np.einsum("ija,j->ia", np.concatenate([self.w[..., None], self.slopes], axis=2), f)


def solved(matrices, vectors):
    return np.linalg.solve(matrices, vectors[..., None])[..., 0]


FIELDS = {  # of x in m: values and gradients; over 1 and 1 / m
    "constant": lambda x: (np.ones(len(x)), 0.0 * x),
    "linear": lambda x: (x @ (1.0, 2.0), np.tile((1.0, 2.0), (len(x), 1))),
    "quadratic": lambda x: (np.sum(x * x, axis=1), 2.0 * x),
}


def errors(field):
    """(estimate, place) -> largest error of values over dp and of gradients, in the middle and at the free surface."""
    x = disordered()
    estimates, (f, gradient) = Estimates(x), FIELDS[field](x)
    middle = np.abs(x[:, 0] - 0.5) < 0.3
    places = {"inside": middle & (np.abs(x[:, 1] - 0.25) < 0.1), "surface": middle & (x[:, 1] > 0.5 - DP)}
    found = {(name, place): np.abs(value - f)[here].max() / DP
             for name, value in estimates.values(f).items() for place, here in places.items()}  # fmt: skip
    slopes = {(name, place): np.abs(value - gradient)[here].max()
              for name, value in estimates.gradients(f).items() for place, here in places.items()}  # fmt: skip
    for table in (found, slopes):
        print(field, {key: float(f"{value:.2g}") for key, value in table.items()})
    return found, slopes


@pytest.mark.parametrize("place", ["inside", "surface"])
def test_corrections_reproduce_what_they_promise(place):
    """Constants by Shepard's mean and by differences, lines by the others; without any not even constants."""
    (values, slopes), (lines, gradients) = errors("constant"), errors("linear")
    least = {"inside": 0.01, "surface": 0.3}[place]
    assert values["(MP 10)", place] * DP > least / 2 and slopes["(MP 11)", place] > least
    assert values["Shepard's mean", place] < 1e-12 > slopes["differences, as in (MP 16)", place]
    assert gradients["differences, as in (MP 16)", place] > least and lines["Shepard's mean", place] > least / 5
    exact = ("RKPM, linear", "Liu & Liu")
    assert max(lines[name, place] for name in exact) < 1e-11
    assert max(gradients[name, place] for name in (*exact, "gradient_correction")) < 1e-11


def test_the_gradient_correction_is_that_of_liu_and_liu_where_the_value_is_known():
    estimates = Estimates(disordered())
    f = np.random.default_rng(2).normal(size=len(estimates.w))
    found = estimates.gradients(f)
    one, other = found["gradient_correction"], found["Liu & Liu, f_i known"]
    assert np.abs(one - other).max() < 1e-11 * np.abs(one).max()


def test_quadratic_fields_are_off_by_the_spacing_with_each_correction():
    """At the surface the uncorrected gradient is off by as much as it is; the corrected ones by about dp f''."""
    _, gradients = errors("quadratic")
    assert gradients["(MP 11)", "surface"] > 1.0 > 10 * DP
    for name in ("gradient_correction", "RKPM, linear", "Liu & Liu"):
        assert gradients[name, "inside"] < 2 * DP and gradients[name, "surface"] < 4 * DP
