"""WHO: ranks and the six verbs between them (fill, fold, migrate, refresh, transpose, sum); the only importer of mpi4py."""
