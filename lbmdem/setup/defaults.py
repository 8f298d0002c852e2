"""Fills in what the settings of a case determine: lattice, periodic axes, names, vectors of full length."""

from hpcpic.core.case.gauge import named
from hpcpic.core.case.words import only_seconds
from lbmdem.case.config import AXES, GrainSet, LbmDemConfig


def completed(config: LbmDemConfig) -> LbmDemConfig:
    """A case completed by names, vectors of full length, and the defaults that other settings determine."""
    d = config.dimensions
    around = {face.face[0] for face in config.boundary if face.type == "periodic"}.union(config.domain.periodic)
    domain = config.domain.model_copy(update={"periodic": tuple(axis for axis in AXES if axis in around)})
    simulation = config.simulation.model_copy(update={"dimensions": d, "lattice": config.lattice})
    fluid = config.fluid
    if fluid is not None:
        tau = 1.0 if fluid.time_step is None else None
        update = {"body_force": padded(fluid.body_force, d), "relaxation_time": fluid.relaxation_time or tau}
        fluid = fluid.model_copy(update=update)
    coupling = config.coupling
    if coupling.refill is None:
        closed = not any(face.is_open for face in config.boundary)
        kept = closed and not coupling.frozen and config.grains_move
        coupling = coupling.model_copy(update={"refill": "mass-conserving" if kept else "local"})
    faces = (face for face in config.boundary if face.type != "periodic")
    boundary = tuple(face.model_copy(update={"velocity": padded(face.velocity, d)}) for face in faces)
    obstacle = tuple(
        o.model_copy(update={"velocity": padded(o.velocity, d), "name": o.name or f"obstacle_{i + 1}"})
        for i, o in enumerate(config.obstacle)
    )
    output = config.output.model_copy(update={"period": only_seconds(config.output.period, config.output.every)})
    return config.model_copy(
        update={
            "output": output,
            "simulation": simulation,
            "domain": domain,
            "fluid": fluid,
            "boundary": boundary,
            "coupling": coupling,
            "obstacle": obstacle,
            "grains": tuple(completed_grains(grains, i, d) for i, grains in enumerate(config.grains)),
            "gauge": named(config.gauge),
            "gravity": padded(config.gravity, d),
        }
    )


def padded(vector: tuple[float, ...], d: int) -> tuple[float, ...]:
    return vector or (0.0,) * d


def completed_grains(grains: GrainSet, i: int, d: int) -> GrainSet:
    return grains.model_copy(
        update={
            "name": grains.name or f"grains_{i + 1}",
            "shape": "disc" if d == 2 else "sphere",
            "velocity": padded(grains.velocity, d),
            "angular_velocity": grains.angular_velocity or (0.0,) * (1 if d == 2 else 3),
        }
    )
