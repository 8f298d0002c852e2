"""Compiled sweeps over nodes, links and contacts: arrays in, arrays out."""
