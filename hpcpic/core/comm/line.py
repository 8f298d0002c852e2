"""The transform of a line cut among ranks: every rank gathers all points and transforms the whole."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.comm import fftw
from hpcpic.core.comm import transpose_kernels as kernels
from hpcpic.core.comm.messages import Message, Messages
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.space.fields import aligned_zeros
from hpcpic.core.tasks.graph import Bound, Graph, Pool, bind


class LineFFT:
    """SlabFFT in one dimension, with the same face.

    real, results[k]   real[n0] views: the points of this rank
    spectrum           complex[N0 // 2 + 1], whole on every rank; valid between forward() and the next call
    multiplier         [N0 // 2 + 1] real or complex, or several of them stacked in front
    """

    def __init__(
        self,
        world: World,
        pool: Pool,
        points: Sequence[int],
        cuts: Sequence[int],
        dtype: DTypeLike = np.float64,
        multiplier: NDArray | None = None,
    ) -> None:
        (n,) = points
        m = n // 2 + 1
        real_type = np.dtype(dtype)
        complex_type = np.dtype(np.complex64 if real_type == np.float32 else np.complex128)
        factors = np.atleast_2d(np.ones(m) if multiplier is None else multiplier)
        self._factors = factors.astype(complex_type if np.iscomplexobj(factors) else real_type)
        self._pool = pool
        self._whole = aligned_zeros((n,), real_type)
        self._results = [aligned_zeros((n,), real_type) for _ in factors]
        self.spectrum = aligned_zeros((m,), complex_type)
        own = slice(cuts[world.rank], cuts[world.rank + 1])
        self.real, self.results = self._whole[own], [whole[own] for whole in self._results]
        self._messages = self._connect(world, cuts)
        with world.first_on_node():  # it compiles
            self._prepare(n, real_type)

    def at(self, iteration: int) -> None:
        """The next transform belongs to this iteration; those after it to the following ones."""
        self._messages.at(iteration)

    def forward(self) -> None:
        """real -> spectrum."""
        self._pool.run(self._forward)

    def backward(self) -> None:
        """spectrum -> results[0], not normalised."""
        self._pool.run(self._backward)

    def solve(self) -> None:
        """real -> results[k], each through multiplier[k]."""
        self._pool.run(self._solve)

    def free(self) -> None:
        """Withdraw receives that nothing has matched."""
        self._messages.free()

    def _connect(self, world: World, cuts: Sequence[int]) -> Messages:
        """Our points to every other rank, theirs into their places."""
        others = [p for p in range(world.size) if p != world.rank]
        theirs = {p: self._whole[cuts[p] : cuts[p + 1]] for p in others}
        sends = [Message(p, Channel.TRANSPOSE, self.real) for p in others if self.real.size]
        receives = [Message(p, Channel.TRANSPOSE, points) for p, points in theirs.items() if points.size]
        return Messages(world.comm, sends=sends, receives=receives)

    def _prepare(self, n: int, real_type: np.dtype) -> None:
        plan = fftw.real_to_complex((n,), real_type)
        forward = bind(kernels.line, plan=plan, source=self._whole, target=self.spectrum)
        plan = fftw.complex_to_real((n,), real_type)
        product = aligned_zeros(self.spectrum.shape, self.spectrum.dtype)

        def back(factor: NDArray, whole: NDArray) -> Bound:
            arrays = {"source": self.spectrum, "factor": factor, "product": product, "target": whole}
            return bind(kernels.line_product, plan=plan, **arrays)

        one = np.ones(n // 2 + 1, real_type)
        self._forward = self._graph([forward], gather=True)
        self._backward = self._graph([back(one, self._results[0])], gather=False)
        backs = [back(factor, whole) for factor, whole in zip(self._factors, self._results)]
        self._solve = self._graph([forward, *backs], gather=True)

    def _graph(self, tasks: list[Bound], gather: bool) -> Graph:
        """The tasks one after the other, after the messages."""
        graph = Graph()
        if gather and len(self._messages):
            graph.message(self._messages, outs=["line"], name="points of a line")
        for task in tasks:
            graph.task(task, inouts=["line"])
        return graph.freeze()
