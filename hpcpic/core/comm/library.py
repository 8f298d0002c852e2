"""Which MPI this is: for the record of a run and for `doctor`."""


def library() -> str:
    """Name and version of the MPI library, one line. Starts MPI."""
    from mpi4py import MPI

    name, version = MPI.get_vendor()
    return f"{name} {'.'.join(map(str, version))}, MPI {MPI.VERSION}.{MPI.SUBVERSION}"


def thread_level() -> str:
    """The level of thread support of MPI. Starts MPI."""
    from mpi4py import MPI

    names = ("SINGLE", "FUNNELED", "SERIALIZED", "MULTIPLE")
    levels = {getattr(MPI, f"THREAD_{name}"): name for name in names}
    return levels[MPI.Query_thread()]
