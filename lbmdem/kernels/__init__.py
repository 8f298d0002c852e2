"""Compiled sweeps over nodes, links and contacts: arrays in, arrays out. They call the formulas of `lbmdem.physics`."""

from hpcpic.core.physics import contact_law
from hpcpic.core.simd.compile import depends_on, formulas
from lbmdem.physics import lubrication, wall_rules

formulas(contact_law, lubrication, wall_rules)
if wall_rules.own.__module__ != wall_rules.__name__:
    depends_on(wall_rules.__name__, wall_rules.own)
