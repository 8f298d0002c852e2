"""What pushes the fluid and changes from step to step: a shaken frame, and pressures that rise or fall at faces."""

from lbmdem.case.config import LbmDemConfig
from lbmdem.fluid.fluid import Fluid
from lbmdem.setup.scene import Scene

HOLD_STEPS = 8  # steps for which the pressure of a creeping flow stays the same


class Drive:
    """Sets body force and face densities of a fluid before each step. changes: anything of it does in this scene."""

    def __init__(self, scene: Scene, fluid: Fluid) -> None:
        self._scene, self._fluid = scene, fluid
        self._shaken = scene.config.shaking is not None
        ramped = any(face.rate for face in scene.faces.values())
        self._creeps = ramped and not self._shaken and creeping(scene.config)
        self.changes = self._shaken or ramped

    def apply(self, step: int) -> None:
        """Body force and pressures for the time step from `step` to step + 1."""
        if self._shaken:
            self._fluid.set_force(self._scene.body_force(step), told=self._scene.body_force(step + 1))
        if self._creeps and step % HOLD_STEPS:
            return
        for name, face in self._scene.faces.items():
            if face.rate:
                density = face.density + face.rate * self.ramp_steps(step + 1)
                if self._creeps:
                    before = face.density + face.rate * self.ramp_steps(step)
                    self._fluid.f *= (density - 1.0) / (before - 1.0)
                self._fluid.set_face(name, density=density)

    def restore(self, step: int) -> None:
        """Body force and pressures as they were after so many steps."""
        if self._shaken:
            self._fluid.set_force(self._scene.body_force(step))
        for name, face in self._scene.faces.items() if self.changes else ():
            if face.rate:
                self._fluid.set_face(name, density=face.density + face.rate * self.ramp_steps(step))

    def ramp_steps(self, step: int) -> int:
        """Number of steps of change that the pressures at a time step have behind them."""
        return (step - 1) // HOLD_STEPS * HOLD_STEPS + 1 if self._creeps and step else step


def creeping(config: LbmDemConfig) -> bool:
    """True for a flow through grains at rest that is proportional to the one pressure that changes.

    Its populations are then scaled with that pressure: a compressible fluid would take the time L^2 mu / (k rho c^2)
    to adjust its pressure in a sample of length L, far longer than water does.
    """
    open_faces = [face for face in config.boundary if face.is_open]
    ramped = [face for face in open_faces if face.pressure_rate and face.pressure]
    still = all(face.type == "pressure" and (face.pressure == 0.0 or face in ramped) for face in open_faces)
    moved = any(any(face.velocity) for face in config.boundary) or any(any(solid.velocity) for solid in config.obstacle)
    fluid = config.fluid
    calm = not moved and fluid is not None and not any(fluid.body_force) and not (fluid.initial or fluid.start)
    return config.coupling.frozen and len(ramped) == 1 and still and calm
