"""Loops over particles and grid rows: arrays in, arrays out."""
