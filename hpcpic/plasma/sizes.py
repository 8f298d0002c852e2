"""How particles and cells are laid out: numbers that both the code and the forecasts read. Without numpy."""

PAGE = 128  # particles
MAX_SPEED = 2.0**40  # cells per step that a particle may have
PLACE_BITS = 40  # a cell is 2^40 parts in sums of positions
EDGE = {1: 256, 2: 16, 3: 8}  # cells of a tile along each axis
