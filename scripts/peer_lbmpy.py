"""lbmpy as a process that takes steps when told to: runs in an environment of its own (scripts/peers.py).

    python peer_lbmpy.py POINTS float64|float32 THREADS AVX|widest PATTERN...

Prints "ready", then for every line of standard input, `PATTERN PAIRS`, the seconds and the seconds of its own processor
time that PAIRS pairs of steps (even, odd) took.
"""

import sys
import time

import numpy as np
import pystencils as ps
from lbmpy import LBMConfig, LBMOptimisation, LBStencil, Method, Stencil, create_lb_update_rule
from lbmpy.advanced_streaming import Timestep


def kernels(points: int, dtype: str, threads: int, vectors: str, pattern: str) -> list:
    """Generated C with vectors, populations without their weights, in place: an even and an odd step."""
    extent = points + 2
    field = ps.fields(f"pdfs(19): {dtype}[{extent},{extent},{extent}]", layout="fzyx")
    compiled = []
    for timestep in (Timestep.EVEN, Timestep.ODD):
        config = LBMConfig(
            stencil=LBStencil(Stencil.D3Q19),
            method=Method.TRT,
            relaxation_rates=[1.6, 0.9],
            compressible=True,
            zero_centered=True,
            streaming_pattern=pattern,
            timestep=timestep,
        )
        rule = create_lb_update_rule(lbm_config=config, lbm_optimisation=LBMOptimisation(symbolic_field=field))
        processor = ps.Target.CurrentCPU if vectors == "widest" else ps.Target.X86_AVX
        target = ps.CreateKernelConfig(target=processor, default_dtype=dtype)
        target.cpu.vectorize.enable = True
        target.cpu.vectorize.assume_inner_stride_one = True
        if threads > 1:
            target.cpu.openmp.enable = True
            target.cpu.openmp.num_threads = threads
        compiled.append(ps.create_kernel(rule, target).compile())
    return compiled


def main() -> None:
    points, dtype, threads, vectors, *patterns = sys.argv[1:]
    extent = int(points) + 2
    pdfs = np.zeros((19, extent, extent, extent), dtype).transpose(3, 2, 1, 0)
    pdfs[...] = 0
    ready = {pattern: kernels(int(points), dtype, int(threads), vectors, pattern) for pattern in patterns}
    print("ready", flush=True)
    for line in sys.stdin:
        pattern, pairs = line.split()
        begin, used = time.perf_counter(), time.process_time()
        for _ in range(int(pairs)):
            for kernel in ready[pattern]:
                kernel(pdfs=pdfs)
        print(time.perf_counter() - begin, time.process_time() - used, flush=True)


if __name__ == "__main__":
    main()
