"""Weakly compressible smoothed particle hydrodynamics, after Minatti & Pasculli (2011), cited as (MP n), and Silvester
and Cleary (2006), cited as (SC n).
"""
