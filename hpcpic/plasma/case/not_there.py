"""What users of other programs look for in a case, and what is there in its place: the answer to such a key."""

from typing import ClassVar

from hpcpic.core.case.schema import Section

PERIODIC = "the box is periodic along every axis: there are no walls, electrodes or open ends"
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
        "B": "the magnetic field is field.magnetic = [Bx, By, Bz]; one that varies in space is an acceleration of "
        "your own",
        "E": "the external electric field is field.electric = [Ex, Ey, Ez]",
    }  # fmt: skip
