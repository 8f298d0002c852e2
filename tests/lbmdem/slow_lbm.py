"""A plain lattice Boltzmann method in numpy, on the whole box, with boundary links as the papers write them.

Populations h = f - w [q, plane, row, x] (2D: one row). Everything is done node by node or link by link.
"""

import numpy as np

from lbmdem.fluid.solid_nodes import kernel_axes


class SlowLbm:
    """Periodic box of shape (planes, rows, x); solid[...]: -1 fluid, else a number. Collision TRT or BGK."""

    def __init__(self, lattice, shape, tau, magic=3 / 16, seed=0):
        self.e = np.rint(kernel_axes(lattice.e)).astype(int)  # (x, row, plane)
        self.w, self.opposite, self.lattice = lattice.w, lattice.opposite, lattice
        self.omega = 1 / tau
        self.omega_minus = self.omega if magic is None else 1 / (magic / (tau - 0.5) + 0.5)
        self.solid = np.full(shape, -1)
        self.h = 0.01 * np.random.default_rng(seed).normal(size=(lattice.q, *shape)) * self.w[:, None, None, None]

    def moments(self, h):
        rho = 1 + h.sum(0)
        return rho, np.einsum("ia,i...->a...", self.e, h) / rho

    def equilibrium(self, rho, u):
        eu = np.einsum("ia,a...->i...", self.e, u)
        w = self.w.reshape(-1, *[1] * rho.ndim)
        return w * (rho * (1 + 3 * eu + 4.5 * eu**2 - 1.5 * (u**2).sum(0)) - 1)

    def collide(self):
        """Post-collision populations; those of solid nodes mean nothing."""
        difference = self.h - self.equilibrium(*self.moments(self.h))
        mirrored = difference[self.opposite]
        even, odd = 0.5 * (difference + mirrored), 0.5 * (difference - mirrored)
        return self.h - self.omega * even - self.omega_minus * odd

    def links(self):
        """All (fluid node, direction, solid node) as rows (x, row, plane), i, (x, row, plane)."""
        nodes = np.argwhere(self.solid == -1)[:, ::-1]
        for i in range(1, len(self.w)):
            beyond = self.wrapped(nodes + self.e[i])
            for x, s in zip(nodes, beyond):
                if self.at(self.solid, s) != -1:
                    yield x, i, s

    def wrapped(self, x):
        return np.mod(x, self.solid.shape[::-1])

    def at(self, values, x):
        return values[..., x[2], x[1], x[0]]

    def step(self, rule, crossing):
        """One step; crossing(x, i, s) -> (row of the body, q, arm, wall velocity). Forces {body: [6]}."""
        g = self.collide()
        new = np.empty_like(g)
        for i, e in enumerate(self.e):
            new[i] = np.roll(g[i], e[::-1], axis=(0, 1, 2))
        forces = {}
        for x, i, s in self.links():
            body, q, arm, u = crossing(x, i, s)
            value, force = self.returned(g, x, i, q, u, rule)
            new[(self.opposite[i], *x[::-1])] = value
            forces.setdefault(body, np.zeros(6))
            forces[body] += [*force, *np.cross(arm, force)]
        self.h = new
        return forces

    def returned(self, g, x, i, q, u, rule):
        """The population that comes back, and the force of the link on the wall."""
        j, e = self.opposite[i], self.e[i]
        y = self.wrapped(x - e)
        z = self.wrapped(y - e)
        free = [self.at(self.solid, p) == -1 for p in (y, z)]
        wall = 6 * self.w[i] * (e @ u)
        out, back = self.at(g[i], x), self.at(g[j], x)
        if rule == "halfway" or not free[0]:
            value = out - wall
        elif rule == "cli":
            value = out + (1 - 2 * q) / (1 + 2 * q) * (self.at(g[i], y) - back) - 2 / (1 + 2 * q) * wall
        elif rule == "interpolated" or not free[1]:
            if q <= 0.5:
                value = 2 * q * out + (1 - 2 * q) * self.at(g[i], y) - wall
            else:
                value = (out - wall) / (2 * q) + (2 * q - 1) / (2 * q) * back
        elif q <= 0.5:
            value = q * (1 + 2 * q) * out + (1 - 4 * q**2) * self.at(g[i], y)
            value += -q * (1 - 2 * q) * self.at(g[i], z) - wall
        else:
            value = (out - wall) / (q * (2 * q + 1)) + (2 * q - 1) / q * back
            value += (1 - 2 * q) / (1 + 2 * q) * self.at(g[j], y)
        return value, e * (out + value) - u * (out - value)
