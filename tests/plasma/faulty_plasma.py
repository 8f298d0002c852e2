"""`python faulty_plasma.py KIND RANK STEP run CASE`: the program with a fault on one rank, in one step."""

import os
import signal
import sys

import numpy as np

from hpcpic.__main__ import main
from hpcpic.core.files import image
from hpcpic.plasma.particles.cloud import Cloud
from hpcpic.plasma.step import Plasma

KIND, RANK, STEP = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def before_step(plasma: Plasma) -> None:
    if KIND == "raise":
        raise ZeroDivisionError("told to fail")
    if KIND == "nan":
        plasma.solve()
        plasma.mesh.e[:] = np.nan


step, push, write_shards = Plasma.step, Cloud.push, image.write_shards
here = False  # in this step, on this rank


def faulty_step(plasma: Plasma) -> None:
    global here
    here = plasma.world.rank == RANK and plasma.iteration == STEP
    if here:
        before_step(plasma)
    step(plasma)


def faulty_push(cloud: Cloud, iteration: int) -> None:
    push(cloud, iteration)
    if here and KIND == "kill":
        die()  # between push and delivery


def faulty_write(path, slots, shards) -> None:
    if here and KIND == "kill in checkpoint":
        write_shards(path, slots, dict(list(shards.items())[:2]))
        die()
    write_shards(path, slots, shards)


Plasma.step, Cloud.push, image.write_shards = faulty_step, faulty_push, faulty_write
del sys.argv[1:4]
main()
