"""WHO: ranks and the six verbs between them; the only importer of mpi4py.

fill, fold, migrate, refresh, transpose, sum.
"""
