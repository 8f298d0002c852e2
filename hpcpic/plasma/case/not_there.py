"""What users of other programs look for in a case, and what is there in its place: the answer to such a key."""

from typing import ClassVar

from hpcpic.core.case.schema import Section

PERIODIC = "the box is periodic along every axis: there are no walls, electrodes or open ends"
ELECTROSTATIC = (
    "the field is electrostatic, of charges alone: there are no currents, no light, and so no laser, no Weibel "
    "instability and no whistlers"
)
NEWTON = "particles move by Newton's law, at speeds far below that of light"
AXES = "temperatures by axis are velocities of `start`, or a loader of your own (docs/start/python.md)"
PLACES = "a density that varies is made of positions of `start`, or a loader of your own (docs/start/python.md)"
AT_REST = "a background that makes the box neutral is there of itself; slow particles are a species of large mass"
NO_GAS = "particles collide with no gas; a drag is an acceleration of your own (docs/start/python.md)"


class Group(Section):
    """A group of a plasma case."""

    instead: ClassVar = {
        **dict.fromkeys(
            ("bc", "bcs", "boundary", "boundaries", "boundary_condition", "boundary_conditions", "boundary_type",
             "wall", "walls", "dirichlet", "neumann", "periodic", "periodicity", "electrode", "electrodes",
             "reflecting", "absorbing", "inlet", "injection"),
            PERIODIC,
        ),
        **dict.fromkeys(
            ("collision", "collisions", "collision_frequency", "collision_rate", "drag", "friction", "gas", "neutrals",
             "ionisation", "ionization", "mcc"),
            NO_GAS,
        ),
        **dict.fromkeys(
            ("electromagnetic", "maxwell", "yee", "fdtd", "laser", "lasers", "antenna", "current", "currents"),
            ELECTROSTATIC,
        ),
        **dict.fromkeys(("relativistic", "relativity", "gamma", "lorentz_factor", "speed_of_light"), NEWTON),
        **dict.fromkeys(("temperature_anisotropy", "anisotropy", "temperature_x", "temperature_y", "temperature_z",
                         "thermal_velocity_x", "thermal_velocity_y", "thermal_velocity_z",
                         "thermal_velocity", "temperature"), AXES),  # the last two where they are a list
        **dict.fromkeys(("profile", "density_profile", "density_gradient", "gradient_length"), PLACES),
        **dict.fromkeys(("mobile", "immobile", "fixed", "frozen", "static", "background"), AT_REST),
        "phase": "waves are sin(k.x); others stand in positions and velocities of `start` (docs/start/python.md)",
        "end_time": "a run is simulation.cycles steps of simulation.time_step",
        "B": "the magnetic field is field.magnetic = [Bx, By, Bz]; one that varies in space is an acceleration of "
        "your own",
        "E": "the external electric field is field.electric = [Ex, Ey, Ez]",
    }  # fmt: skip
