"""Formulas that several simulators share, with their sources: no arrays, no machinery."""
