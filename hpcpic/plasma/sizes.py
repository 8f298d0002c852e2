"""How particles and cells are laid out: numbers that both the code and the forecasts read. Without numpy."""

PAGE = 128  # particles
MAX_SPEED = 2.0**40  # cells per step that a particle may have
PLACE_BITS = 40  # a cell is 2^40 parts in sums of positions
WHOLE_BITS = {8: 44, 4: 20}  # a particle's charge is 2^44 parts, in single precision 2^20 (that of its position)
EDGE = {1: 256, 2: 16, 3: 8}  # cells of a tile along each axis


def record_numbers(components: int, itemsize: int) -> int:
    """Numbers of a particle under way: its components, and in the same memory three integers of 32 bits behind them."""
    return 8 if components * itemsize + 12 <= 8 * itemsize else 16
