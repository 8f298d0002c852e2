"""E = -grad phi by centred differences (5.13)."""

from itertools import pairwise

import numpy as np
import pytest

from hpcpic.plasma.kernels.mesh import minus_gradient_1d, minus_gradient_2d, minus_gradient_3d


def with_ghosts(phi):
    """One ghost below and left, two above and right, of a periodic array."""
    for axis in range(phi.ndim):
        nodes = np.arange(-1, phi.shape[axis] + 2) % phi.shape[axis]
        phi = phi.take(nodes, axis)
    return np.ascontiguousarray(phi)


def field_of(phi, spacing, e0=(0.0, 0.0, 0.0), cuts=()):
    """E[component, points + 1] of a periodic phi, row ranges computed one by one."""
    e = np.full((phi.ndim, *(n + 1 for n in phi.shape)), np.nan, phi.dtype)
    edges = [0, *cuts, phi.shape[0] + 1]
    factors = [phi.dtype.type(1 / (2 * step)) for step in reversed(spacing)]
    kernel = (minus_gradient_1d, minus_gradient_2d, minus_gradient_3d)[phi.ndim - 1]
    for first, last in pairwise(edges):
        external = [phi.dtype.type(value) for value in e0[: phi.ndim]]
        kernel(first, last, with_ghosts(phi), e, *factors, *external)
    return e


def test_order_two_with_spacings_of_their_own():
    errors = []
    for n in (16, 32, 64):
        y, x = np.meshgrid(np.arange(n) / n, np.arange(2 * n) * 3 / (2 * n), indexing="ij")
        wave = 2 * np.pi / 3
        e = field_of(np.sin(wave * x) * np.cos(2 * np.pi * y), (1 / n, 3 / (2 * n)))[:, :-1, :-1]
        e_x = -wave * np.cos(wave * x) * np.cos(2 * np.pi * y)
        e_y = 2 * np.pi * np.sin(wave * x) * np.sin(2 * np.pi * y)
        errors.append([np.abs(e[0] - e_x).max(), np.abs(e[1] - e_y).max()])
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert np.all(np.abs(orders - 2) < 0.05), orders


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("shape", [(5, 8), (1, 3), (17, 33)])
def test_printed_formula_and_external_field(dtype, shape):
    phi = np.random.default_rng(1).standard_normal(shape).astype(dtype)
    e = field_of(phi, (0.5, 0.25), (3.0, -2.0))
    e_x = 3 + 2 * (np.roll(phi, 1, 1) - np.roll(phi, -1, 1))
    e_y = -2 + (np.roll(phi, 1, 0) - np.roll(phi, -1, 0))
    for got, want in zip(e, (e_x, e_y), strict=True):
        assert np.array_equal(got, np.pad(want, (0, 1), mode="wrap")), "ghost row and column repeat the first"


def test_one_dimension():
    phi = np.random.default_rng(2).standard_normal(9)
    e = field_of(phi, (0.25,), (1.0,))
    assert np.array_equal(e[0], np.pad(1 + 2 * (np.roll(phi, 1) - np.roll(phi, -1)), (0, 1), mode="wrap"))


def test_three_dimensions():
    phi = np.random.default_rng(4).standard_normal((5, 6, 7))
    e = field_of(phi, (0.5, 0.25, 1.0), (1.0, 2.0, 3.0))
    for axis, (got, step) in enumerate(zip(e, (1.0, 0.25, 0.5), strict=True)):
        along = 2 - axis
        want = 1.0 + axis + (np.roll(phi, 1, along) - np.roll(phi, -1, along)) / (2 * step)
        assert np.array_equal(got, np.pad(want, (0, 1), mode="wrap"))


@pytest.mark.parametrize("shape", [(13, 22), (29,), (13, 4, 5)])
def test_cuts_keep_the_bits(shape):
    phi = np.random.default_rng(3).standard_normal(shape)
    spacing = (0.3, 0.7, 0.4)[: len(shape)]
    uniform = (0.1, 0.2, 0.3)
    assert np.array_equal(field_of(phi, spacing, uniform, (3, 4, 11)), field_of(phi, spacing, uniform))
