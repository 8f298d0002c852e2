"""Between physical units and those of the lattice: spacing, time step and density of rest are 1 there."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Units:
    """dx [m], dt [s], rho [kg/m3]; in two dimensions quantities are per metre of depth.

    Each property is the physical value of one lattice unit: physical = lattice * unit.
    """

    dx: float
    dt: float
    rho: float
    dimensions: int

    @property
    def velocity(self) -> float:
        return self.dx / self.dt

    @property
    def acceleration(self) -> float:
        return self.dx / (self.dt * self.dt)

    @property
    def mass(self) -> float:
        return self.rho * self.dx**self.dimensions

    @property
    def force(self) -> float:
        return self.mass * self.acceleration

    @property
    def torque(self) -> float:
        return self.force * self.dx

    @property
    def pressure(self) -> float:
        return self.rho * self.velocity * self.velocity
