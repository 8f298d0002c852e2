"""Compiled loops over grains and contacts: arrays in, arrays out."""
