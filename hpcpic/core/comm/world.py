"""All ranks of a run: who is there, which cores they have, and the few collectives that steps need."""

import os
import shutil
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.cores import allotted
from hpcpic.core.errors import HpcpicError

if TYPE_CHECKING:
    from mpi4py import MPI

NAP_SECONDS = 5e-4


class LauncherMismatch(HpcpicError):
    """mpirun belongs to another MPI than mpi4py: every process would believe that it is alone."""

    exit_code = 2


class NoMpi(HpcpicError):
    """mpi4py is there, as always, but no MPI library that it could load."""

    exit_code = 2


def load_mpi() -> ModuleType:
    """mpi4py.MPI, whose import starts MPI. Raises NoMpi where there is no library."""
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:  # of an mpi4py built for one library; of a wheel that looks for any
        reason = str(error).partition("\n")[0]
        raise NoMpi(
            f"no MPI: {reason}. `pip install mpich` brings one; on a cluster load its module (docs/start/cluster.md)"
        ) from error
    return MPI


def launched_size(environ: Mapping[str, str]) -> int:
    """The least number of processes that the launcher says it started; 1 without a launcher.

    Hydra and PMI-2 tell it in PMI_SIZE, Open MPI in OMPI_COMM_WORLD_SIZE, other PMIx launchers only a rank.
    """
    sizes = [int(environ.get(name) or 1) for name in ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE")]
    return max(*sizes, int(environ.get("PMIX_RANK") or 0) + 1)


def check_launcher(environ: Mapping[str, str], size: int, library: str) -> None:
    """Raise LauncherMismatch when the launcher started more processes than the library sees."""
    launched = launched_size(environ)
    if launched > size:
        beside = Path(sys.prefix, "bin", "mpirun")
        found = shutil.which("mpirun") or "none"
        raise LauncherMismatch(
            f"mpirun started {launched} processes, but {library} sees {size}: they are not of the same MPI. "
            f"Use {beside if beside.exists() else f'the mpirun of {library} (found: {found})'}"
        )


class World:
    """The ranks of COMM_WORLD. With one rank no method communicates."""

    def __init__(self, comm: "MPI.Comm", node: "MPI.Comm") -> None:
        self.comm = comm
        self.rank: int = comm.Get_rank()
        self.size: int = comm.Get_size()
        self.node = node
        self.node_rank: int = node.Get_rank()
        self.node_size: int = node.Get_size()
        self._cores = sorted(os.sched_getaffinity(0))

    @classmethod
    def start(cls) -> "World":
        """Start MPI (all ranks together), or be the only rank when no launcher was used.

        Raises NoMpi, and LauncherMismatch.
        """
        MPI = load_mpi()
        comm = MPI.COMM_WORLD
        check_launcher(os.environ, comm.Get_size(), " ".join(MPI.get_vendor()[0].split()))
        node = comm.Split_type(MPI.COMM_TYPE_SHARED) if comm.Get_size() > 1 else MPI.COMM_SELF
        return cls(comm, node)

    @classmethod
    def alone(cls) -> "World":
        """This process as the only rank, whoever else runs: for measurements that one rank makes."""
        MPI = load_mpi()
        return cls(MPI.COMM_SELF, MPI.COMM_SELF)

    def cpus(self, threads: int) -> list[int]:
        """Cores for the workers of this rank, as `Pool` takes them; collective.

        One for each worker when the ranks fill the node: apart from those of its other ranks. All there are when the
        node has more: which of them another program uses only the system knows. None when it has fewer. Right whether
        the launcher bound the ranks to cores or not, if all ranks have equally many threads.
        """
        workers, there = self.node_size * threads, np.count_nonzero(self._ranks_on_core())
        if workers != there:
            return list(self._cores) if workers < there else []
        first = self.node_rank * threads
        return [self._cores[(first + worker) % len(self._cores)] for worker in range(threads)]

    def cores(self) -> int:
        """Cores of this node that its ranks may use; collective."""
        return allotted(int(np.count_nonzero(self._ranks_on_core())))

    def default_threads(self) -> int:
        """Threads per rank that fill what the node allots; collective."""
        ranks_on_core = self._ranks_on_core()
        there = int(np.count_nonzero(ranks_on_core))
        granted = allotted(there)
        if granted == there and ranks_on_core.max() == 1:
            return len(self._cores)
        return max(1, granted // self.node_size)

    def _ranks_on_core(self) -> NDArray[np.int64]:
        """How many ranks of the node may use each core; collective."""
        ranks = np.zeros(max(os.cpu_count() or 1, self._cores[-1] + 1), np.int64)
        ranks[self._cores] = 1
        if self.node_size > 1:
            self.node.Allreduce(ranks.copy(), ranks)
        return ranks

    def bcast(self, content: bytes | None) -> bytes:
        """The bytes of rank 0, on all ranks."""
        if self.size == 1:
            return content or b""
        length = np.array([len(content or b"")], np.int64)
        self.comm.Bcast(length)
        buffer = np.empty(length[0], np.uint8)
        if self.rank == 0:
            buffer[:] = np.frombuffer(content or b"", np.uint8)
        self.comm.Bcast(buffer)
        return buffer.tobytes()

    def barrier(self) -> None:
        if self.size > 1:
            self.comm.Barrier()

    def wait_for_work(self) -> None:
        """A barrier for what takes long on one rank, as reading a case or compiling: the others sleep, and leave their
        cores to it.
        """
        if self.size > 1:
            _sleep_until(self.comm.Ibarrier())

    def max(self, value: float) -> float:
        return float(self.max_array(np.array([value], np.float64))[0])

    def max_array(self, values: NDArray) -> NDArray:
        """Elementwise maximum over ranks."""
        return self._reduce(values, "MAX")

    def sum_int(self, values: NDArray[np.int64]) -> NDArray[np.int64]:
        """Elementwise sum over ranks; integers, so exact in any order."""
        assert values.dtype == np.int64
        return self._reduce(values, "SUM")

    def sum_exact(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums [k] of values[n, k] over the rows of all ranks, with the same bits however they are divided; not a
        number where a value is none. Collective.
        """
        from hpcpic.core.space import exact

        columns = np.ascontiguousarray(values.T)
        most = self.max_array(np.abs(columns).max(axis=1, initial=0.0))
        if not np.all(np.isfinite(most)):
            return np.full(values.shape[1], np.nan)
        scales = [exact.power_of_two_above(m) for m in most]
        limbs = np.zeros((len(columns), exact.LIMBS), np.int64)
        for of_column, column, scale in zip(limbs, columns, scales):
            exact.add_limbs(of_column, column, 1.0 / scale)
        limbs = self.sum_int(limbs.ravel()).reshape(-1, exact.LIMBS)
        return np.array([exact.value(limb, scale) for limb, scale in zip(limbs, scales)])

    def any(self, flag: bool) -> bool:
        return bool(self._reduce(np.array([flag], np.int64), "MAX")[0])

    def _reduce(self, values: NDArray, operation: str) -> NDArray:
        if self.size == 1:
            return values.copy()
        from mpi4py import MPI

        result = np.empty_like(values, order="C")
        self.comm.Allreduce(np.ascontiguousarray(values), result, getattr(MPI, operation))
        return result

    def gather_rows(self, rows: NDArray) -> NDArray | None:
        """All ranks' arrays [n_r, ...] joined in rank order, on rank 0; None on the others."""
        if self.size == 1:
            return rows.copy()
        from mpi4py import MPI

        rows = np.ascontiguousarray(rows)
        counts = np.zeros(self.size, np.int64)
        self.comm.Gather(np.array([len(rows)], np.int64), counts)
        row_type = MPI.BYTE.Create_contiguous(_row_bytes(rows)).Commit()
        if self.rank == 0:
            result = np.empty((counts.sum(), *rows.shape[1:]), rows.dtype)
            self.comm.Gatherv([rows, len(rows), row_type], [result, counts, row_type])
        else:
            result = None
            self.comm.Gatherv([rows, len(rows), row_type], None)
        row_type.Free()
        return result

    @contextmanager
    def first_on_node(self) -> Iterator[None]:
        """The body runs on the first rank of each node, and on the node's other ranks after that."""
        if self.node_rank > 0:
            _sleep_until(self.node.Ibarrier())
        try:
            yield
        finally:
            if self.node_rank == 0 and self.node_size > 1:
                _sleep_until(self.node.Ibarrier())

    def abort(self, code: int) -> None:
        """End all ranks now. The cause has been printed; the abort itself prints nothing."""
        sys.stdout.flush()
        sys.stderr.flush()
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        self.comm.Abort(code)


def _sleep_until(request: "MPI.Request") -> None:
    while not request.Test():
        time.sleep(NAP_SECONDS)


def _row_bytes(rows: NDArray) -> int:
    return int(np.prod(rows.shape[1:], dtype=np.int64)) * rows.itemsize
