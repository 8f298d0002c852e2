"""Lattice Boltzmann fluid with discrete-element grains, after Mansouri, Delenne, El Youssoufi & Seridi (2011), whose
numbered equations are cited as [1] to [7].
"""
