"""How particles and nodes are laid out, for what holds them and for what foretells it (without numpy)."""

PAGE = 128  # particles
EDGE = {1: 256, 2: 16}  # cells of a tile along each axis
GHOSTS = {"NGP": (0, 1), "CIC": (0, 1), "TSC": (1, 2)}  # layers of nodes below and above that a shape reaches
