"""Compiled sweeps over nodes, links and contacts: arrays in, arrays out. They call the formulas of `lbmdem.physics`."""

from hpcpic.core.simd.compile import formulas
from lbmdem.physics import contact_law, lubrication, wall_rules

formulas(contact_law, lubrication, wall_rules)
