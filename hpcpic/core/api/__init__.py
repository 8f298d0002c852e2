"""The face in Python, the same for every simulator: cases, runs, simulations in memory, results.

Each simulator's package exports the names of `faces`, bound to its own program.
"""
