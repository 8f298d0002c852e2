"""How a uniform force per volume enters a collision. A new scheme is an entry here, and its name where it is chosen."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Forcing:
    """A scheme: the fluid's momentum is sum_i f_i e_i + `share` F, and each population gets a source term.

    The source is that of Guo, Zheng & Shi, w_i (3 (e_i - u) + 9 (e_i . u) e_i) . F, its even part (of opposite
    directions) and its odd part times 1 - share omega, with the rates omega of these.
    """

    name: str
    share: float

    def factor(self, rate: float) -> float:
        """What the collision leaves of a source term that is relaxed at this rate."""
        return 1 - rate * self.share


GUO = Forcing("Guo", 0.5)  # Guo, Zheng & Shi, Phys. Rev. E 65 (2002) 046308: second order in time
