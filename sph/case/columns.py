"""Names and units of the columns of an SPH run's series."""

from collections.abc import Iterator

from hpcpic.core.case.columns import joined
from sph.case.bodies import Body
from sph.case.config import AXES, Gauge, SphConfig, name_of


def series_units(config: SphConfig) -> dict[str, str]:
    """Unit of each column of a case's series. Raises ConfigError where two of them have one name."""
    return joined([*of_scene(config), ("a gauge", gauge_units(config))])


def scalar_units(config: SphConfig) -> dict[str, str]:
    """All but gauges."""
    return {column: unit for _, columns in of_scene(config) for column, unit in columns.items()}


def of_scene(config: SphConfig) -> Iterator[tuple[str, dict[str, str]]]:
    """Columns of the fluid and of each wall. In 2D masses, energies and forces are those of a slice one metre thick."""
    d = config.dimensions
    per = "/m" if d == 2 else ""
    force, turn = f"N{per}", "N" if d == 2 else "N m"
    units = dict.fromkeys(("energy_kinetic", "energy_potential", "energy_internal", "energy_total"), f"J{per}")
    units |= {"mass": f"kg{per}"} | {f"momentum_{axis}": f"kg m/s{per}" for axis in AXES[:d]}
    units |= {"max_velocity": "m/s", "max_density_error": "1", "front_x": "m", "dt": "s", "strays": "1"}
    if config.exchanges:
        units |= dict.fromkeys(("inflow", "outflow", "mass_total"), f"kg{per}")
    yield "the fluid", units
    for i, wall in enumerate(config.wall):
        name, units = name_of("wall", i, wall), dict[str, str]()
        if wall.body:
            units |= body_columns(name, wall.body, d)
        if wall.measure_force or wall.body:
            units |= {f"force_{name}_{axis}": force for axis in AXES[:d]}
            units |= {f"torque_{name}_{axis}": turn for axis in (AXES if d == 3 else "z")}
            units |= {f"impulse_{name}": f"N s{per}"}
            units |= {f"impulse_{name}_{axis}": f"N s{per}" for axis in AXES[:d]}
        yield f"wall {name!r}", units


def body_columns(name: str, body: Body, d: int) -> dict[str, str]:
    """Columns of a rigid body, with their units: angle is the rotation from the initial one, about its axis; contact
    the impulse of what it has touched; hinge the force of its hinge on it over the last step; mooring the tension of a
    line.
    """
    turns, per = (AXES, "") if d == 3 else (AXES[2:], "/m")
    units = {f"position_{name}_{axis}": "m" for axis in AXES[:d]} | {f"angle_{name}_{axis}": "rad" for axis in turns}
    units |= {f"velocity_{name}_{axis}": "m/s" for axis in AXES[:d]}
    units |= {f"spin_{name}_{axis}": "rad/s" for axis in turns}
    units |= {f"contact_{name}_{axis}": f"N s{per}" for axis in AXES[:d]}
    units |= {f"hinge_{name}_{axis}": f"N{per}" for axis in AXES[:d] if body.hinge}
    return units | {f"mooring_{name}_{i + 1}": f"N{per}" for i in range(len(body.mooring))}


def gauge_units(config: SphConfig) -> dict[str, str]:
    """Unit of each column of all gauges."""
    units: dict[str, str] = {}
    for i, gauge in enumerate(config.gauge):
        units |= columns_of(gauge, name_of("gauge", i, gauge), config.dimensions)
    return units


def columns_of(gauge: Gauge, name: str, d: int) -> dict[str, str]:
    """Columns of one gauge, with their units."""
    names = [f"{name}_{axis}" for axis in AXES[:d]] if gauge.kind.vector else [name]
    return dict.fromkeys(names, gauge.kind.units[d - 2])
