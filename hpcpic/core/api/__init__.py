"""The face in Python, the same for every simulator: cases, runs, simulations in memory, results.

Each simulator's `api.py` binds them to its own program.
"""
