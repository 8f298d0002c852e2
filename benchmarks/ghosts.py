"""What share of a step messages of grains' ghosts take: mpirun -n 2 python -m mpi4py benchmarks/ghosts.py lbmdem

The scenes are those of benchmarks/balance.py, with cuts by cost, which go through grains. A message is timed where both
ranks begin it together, so it is without what they wait for each other, and the fastest of many counts; so does the
fastest step, which has messages and waiting in it.
"""

import sys
from time import perf_counter

import numpy as np
from balance import SCENES

from hpcpic.core.comm.world import World
from lbmdem.step import LbmDem

STEPS, MESSAGES = 60, 500


def main() -> None:
    world = World.start()
    model = SCENES[sys.argv[1]](world)
    assert isinstance(model, LbmDem) and model.dem
    grains, sent = model.dem.grains, 0
    refresh = grains.refresh

    def counted() -> None:
        nonlocal sent
        sent += 1
        refresh()

    best = np.full(2, np.inf)
    for _ in range(MESSAGES):
        world.barrier()
        begin = perf_counter()
        refresh()
        best[0] = min(best[0], perf_counter() - begin)
    grains.refresh = counted  # type: ignore[method-assign]
    for _ in range(STEPS):
        world.barrier()
        begin = perf_counter()
        model.step()
        world.barrier()
        best[1] = min(best[1], perf_counter() - begin)
    message, step = world.max_array(best).tolist()
    each, ghosts = sent / STEPS, world.max(grains.n_ghosts)
    if world.rank == 0:
        sys.stdout.write(
            f"{grains.number} grains, {ghosts:.0f} ghosts: {each:.1f} messages a step of {1e6 * message:.0f} us in "
            f"{1e3 * step:.2f} ms, {each * message / step:.1%}\n"
        )


if __name__ == "__main__":
    main()
