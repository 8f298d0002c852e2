"""A scalar of the series and a field of species of one's own: the flux of kinetic energy along x, and the temperature
of the velocities along x alone.

python examples/own_scalar.py, or name "T_x" in output.fields of a case and run it with --use examples/own_scalar.py
"""

import numpy as np

import hpcpic
from hpcpic.plasma.diagnostics import scalars
from hpcpic.plasma.physics import species_fields
from hpcpic.plasma.physics.moments import VELOCITY, Moment


def square_times_velocity(vx, vy, vz, square):
    """|v|^2 v, of a particle or of many at once: compiled into the sums."""
    return square * vx, square * vy, square * vz


def square_along_x(vx, vy, vz, square):
    """v_x^2."""
    return vx * vx


ENERGY_FLUX = Moment(square_times_velocity, power=3, vector=True)
ALONG_X = Moment(square_along_x, power=2)


def energy_flux_x(sample):
    """Sum of m |v|^2 v_x / 2 over all particles, W m."""
    return float(sum(0.5 * species.m * species[ENERGY_FLUX][0] for species in sample.species))


def temperature_x(sample):
    """m <(v_x - u_x)^2> at the nodes, J."""
    return sample.m * (sample[ALONG_X] - sample[VELOCITY][..., 0] ** 2)


scalars.register(scalars.Scalar("energy_flux_x", "W m", energy_flux_x, (ENERGY_FLUX,)))
species_fields.register(species_fields.SpeciesField("T_x", "J", temperature_x, (ALONG_X, VELOCITY)))

if __name__ == "__main__":
    u, thermal = 1.0, 0.5
    case = hpcpic.Case(
        description="a warm beam",
        simulation={"cycles": 20, "time_step": 0.1, "space_length": [16.0, 16.0]},
        grid={"points": [8, 8]},
        species=[
            {"name": "beam", "particles": 20000, "charge": -1.0, "mass": 1.0, "plasma_frequency": 0.1,
             "drift_velocity": [u, 0.0], "thermal_velocity": thermal},
        ],
        output={"fields": ["T_x"]},
    )  # fmt: skip

    with case.simulation(threads=1) as sim:
        sim.advance()
        values, along_x = sim.scalars(), float(np.mean(sim.fields("T_x_beam")))
        digest, rank = sim.digest(), sim.rank

    if rank == 0:
        flux = values["energy_flux_x"] / values["energy_kinetic"]
        theory = u * (u * u + 4.0 * thermal * thermal) / (u * u + 2.0 * thermal * thermal)
        print(f"energy moves at {flux:.3f} m/s, that of Maxwell's velocities at {theory:.3f} m/s")
        print(f"temperature along x {along_x:.3f} J, by theory {thermal * thermal:.3f} J")
        print(digest)
