"""Message tags that carry the iteration, so that a late message never matches another iteration's receive."""

from enum import IntEnum

CHANNELS = 64
WINDOW = 512  # CHANNELS * WINDOW = 32768: the largest tag is the 32767 that MPI guarantees


class Channel(IntEnum):
    """One channel per exchange of a program: at most one message each way between two ranks at a time."""

    POTENTIAL = 0
    CHARGE = 1
    FIELD = 2
    MOMENTS = 6
    PARTICLES = 8
    PARTICLES_FAR = 9
    PARTICLES_WANTED = 10
    GHOSTS = 13
    SHARDS = 16
    RECUT = 17
    POPULATIONS_UP = 18
    POPULATIONS_DOWN = 19
    SOLIDS = 20
    EDGES = 21
    TRANSPOSE = 32  # and the channels after it, one per chunk

    @property
    def far(self) -> "Channel":
        """The channel of the second, general round of a migration."""
        return Channel(self + 1)

    @property
    def wanted(self) -> "Channel":
        """The channel on which ranks learn whether any wants that round."""
        return Channel(self + 2)


def tag(iteration: int, channel: int) -> int:
    """The tag of `channel` at `iteration` >= -2; iterations differ in tag unless they are 512 apart."""
    return (iteration % WINDOW) * CHANNELS + channel
