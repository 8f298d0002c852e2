"""When the total energy says that a run is no solution: it grows without end, or it jumps."""

from __future__ import annotations

import math

GROWTH = 30.0  # of the total energy, beyond which a run is no solution; wp dt = 1.6 gives 1.4 in 100 / wp
JUMP = 0.01  # of the energy between two looks that may be a jump, and is one if it is also
TENFOLD = 10.0  # times the largest change seen before, beyond the fastest growth that a plasma can have
MIN_CHANGES = 3  # seen before that speak for the next
STEPS_BETWEEN_LOOKS = 100  # after which the energy is seen again, written or not; it costs 0.9 of a step
MIN_PARTICLES = 1000  # in fewer one encounter may make the energy jump


class EnergyWatch:
    """The total energy as it is seen now and then. It is conserved but for what the grid heats and what a growing wave
    makes of the errors of the scheme, which grow no faster than exp(2 wp t).

    cold: energy [J] of the coldest plasma that the grid stands, below which growth is heating. wp: 1/s.
    """

    def __init__(self, cold: float, wp: float, particles: int) -> None:
        self.cold, self.wp, self.particles = cold, wp, particles
        self.first = self.last = math.nan
        self.time, self.step, self.seen, self.largest = 0.0, -STEPS_BETWEEN_LOOKS, 0, 0.0
        self.jump: str | None = None

    def see(self, energy: float, time: float, step: int) -> None:
        """The energy [J] at a time [s]."""
        if math.isnan(self.first):
            self.first = energy
        else:
            change = abs(energy - self.last)
            grown = math.exp(min(2.0 * self.wp * abs(time - self.time), 700.0))
            usual = max(JUMP * (self.first + self.cold), TENFOLD * self.largest * grown)
            if self.particles >= MIN_PARTICLES and self.seen >= MIN_CHANGES and change > usual:
                self.jump = f"the total energy jumped from {self.last:.4g} J to {energy:.4g} J at t = {time:.6g} s"
            self.largest, self.seen = max(self.largest, change), self.seen + 1
        self.last, self.time, self.step = energy, time, step

    def trouble(self) -> str | None:
        """Why the run is no solution, or None."""
        if not math.isfinite(self.last) and math.isfinite(self.first):
            return "the total energy is not finite"
        if self.last > GROWTH * (self.first + self.cold):
            return f"the total energy grew from {self.first:.4g} J to {self.last:.4g} J"
        return self.jump
