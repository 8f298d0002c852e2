"""WHEN: a run from its first step to its last.

loop        loop.py steps a model (model.py), guard.py lets the ranks agree, signals.py and triggers.py say when
output      outputs.py, gauges.py, progress.py, log.py, summary.py
state       checkpoint.py; balance.py lays it out anew on other cuts
failure     failure.py reports it once, worst.py shows the particles and nodes of it
compiling   compiling.py measures and reports it
"""
