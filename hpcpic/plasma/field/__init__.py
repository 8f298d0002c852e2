"""Charge and field of a slab."""
