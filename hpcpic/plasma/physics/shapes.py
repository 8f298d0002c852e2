"""The shapes of a particle: how many nodes it reaches along an axis, how much room its kernels need, how it heats.

A shape of order m is the m-fold convolution of a box one cell wide with a point: NGP, CIC and TSC reach 1, 2 and 3
nodes along an axis, and the transform of the shape of n nodes is sinc(k dx/2)^n (Birdsall & Langdon, chapters 4 and 8).
The weights themselves stand in kernels.weights, for single particles, and in the kernels named here, for vectors.
"""

from dataclasses import dataclass

# Cells (CIC) or nodes (NGP, TSC) of a tile with what vectors read beyond them, by axes of the grid
LINEAR_CELLS = {1: 256 + 8, 2: 256 + 8, 3: 512 + 8}
NODAL_CELLS = {1: 17 * 24 + 8, 2: 17 * 24 + 8, 3: 9 * 9 * 16 + 8}


@dataclass(frozen=True, slots=True)
class Heating:
    """Rates at which the grid heats a plasma of Debye length lambda_D, in d ln W / d(wp t).

    debye: lambda_D/dx. noise: rate of the particles' noise times their number per cell. aliases: rate of the aliases.
    """

    debye: float
    noise: float
    aliases: float


@dataclass(frozen=True, slots=True)
class Shape:
    """One shape. nodes: reached along an axis. ghosts: layers of nodes below and above a slab that it reaches.

    vector_kernels: files of kernels/ that gather and deposit by vectors. heating: measured rates by rising lambda_D/dx
    (2D, centred differences, wp dt = 0.2, random starts, on 64 x 64 and 32 x 32 points: fitted to the energies after
    wp t = 875 with 16 and 64 particles per cell, of CIC at 0.3 and TSC at 1.0 also later, which they give within 8 %);
    none where nothing was measured.
    """

    name: str
    nodes: int
    ghosts: tuple[int, int]
    vector_kernels: tuple[str, ...]
    heating: tuple[Heating, ...] = ()

    def charge_scratch(self, dimensions: int) -> int:
        """Sums of charge that a block keeps for a tile: one per node that a particle reaches, in 1D as in 2D."""
        return (NODAL_CELLS if self.nodes % 2 else LINEAR_CELLS)[dimensions] * self.nodes ** max(dimensions, 2)

    def field_scratch(self, dimensions: int) -> int:
        """Coefficients of the field that a block keeps for a tile: as many for each component of E, in 1D as in 2D."""
        return max(dimensions, 2) * self.charge_scratch(dimensions)


SHAPES = {
    shape.name: shape
    for shape in (
        Shape("NGP", 1, (0, 1), ("nodal", "nearest")),
        Shape(
            "CIC", 2, (0, 1), ("linear",),
            (Heating(0.03, 4.3e-4, 1.4e-3), Heating(0.1, 1.0e-2, 2.8e-3), Heating(0.3, 8.6e-3, 6.6e-5),
             Heating(0.5, 3.4e-3, 8e-7), Heating(0.7, 8.9e-4, 1e-7), Heating(1.0, 5.0e-4, 4e-8)),
        ),
        Shape(
            "TSC", 3, (1, 2), ("nodal", "quadratic"),
            (Heating(0.03, 3.2e-3, 3.9e-4), Heating(0.1, 5.1e-3, 1.8e-4), Heating(0.3, 1.9e-3, 5e-6),
             Heating(0.5, 6.5e-4, 8e-7), Heating(1.0, 1.1e-4, 4e-8)),
        ),
    )
}  # fmt: skip
