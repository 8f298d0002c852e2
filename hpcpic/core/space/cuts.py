"""Even shares of rows and items, for plans too: without numpy, which takes longer to import than a plan to make."""

from itertools import pairwise


def block_ranges(n: int, parts: int) -> list[tuple[int, int]]:
    """Ranges (low, high) of n items in `parts` parts; the first get the extra items, some may be empty."""
    size, extra = divmod(n, parts)
    edges = [part * size + min(part, extra) for part in range(parts + 1)]
    return list(pairwise(edges))


def even_cuts(rows: int, ranks: int) -> tuple[int, ...]:
    """The ranks + 1 row numbers that share `rows` evenly."""
    return (0, *(high for _, high in block_ranges(rows, ranks)))
