"""Compiled loops over particles and pairs: arrays in, arrays out."""
