"""Who is in a slot: flags, 0 where nobody is, and keys = number of the particle CODES + number of its image."""

FLUID = 1
REAL = 2  # its sums are used; images only give
REPULSIVE = 4  # of a repulsive wall
FLOWS = 8  # density flows in and out: of fluid and its images, but not in mirrors
PLAIN = 16  # it meets nothing but fluid (kernels.runs)
BODY = 32
OWN = 64  # particles of this rank
MINE = FLUID | OWN
FLOWING_FLUID = FLUID | REAL | FLOWS
PARTNERS = FLUID | REAL  # two meet of which one is fluid and one real
EXTRAPOLATED = 128  # of a wall whose density follows from the fluid before it
NO_DENSITY = REPULSIVE | EXTRAPOLATED  # that evolves
SLIPS = 256  # of a wall without friction
SOLID = 9
SOLIDS = 255 << SOLID  # number of a solid that presses on others across films (its wall + 1, below 128), 0 for all else
NORMAL = 17  # flags >> this: number of the normal of a repulsive particle

LIQUID = NORMAL  # flags >> this: number of the liquid of fluid (physics.liquids)

EDGE = 1 << 29  # of a wall whose density follows from the fluid before it: near an edge, in scenes of one liquid

CODES = 64
WALL_BITS = 50  # number >> this: number of the wall + 1, 0 for fluid
WALL_SHIFT = WALL_BITS + 6  # key >> this: the same
