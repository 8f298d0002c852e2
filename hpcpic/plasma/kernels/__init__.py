"""Loops over particles and grid rows: arrays in, arrays out."""

from hpcpic.core.simd.compile import formulas
from hpcpic.plasma.physics import boris

formulas(boris)
