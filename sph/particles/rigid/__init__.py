"""Rigid bodies of a run: their motion, what they touch, and what holds them."""
