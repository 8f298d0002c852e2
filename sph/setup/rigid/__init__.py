"""Rigid bodies at rest: mass and inertia, rotations, and points of their surfaces."""
