"""Electrostatic particle-in-cell plasma, after the thesis of R. Arias Mallo (2019), whose equations are cited as (5.1).

Departures, all of them in docs/theory/plasma.md: (4.2), (5.18) and (5.19) are read as dx/dt = v and divided by dt;
(5.1) is divided by the volume of a cell; every axis has its own spacing in (5.3), (5.4), (5.11) and (5.12); LU pins by
5/4; s = 2 t / (1 + |t|^2) in the Boris rotation (5.4.1), which is carried out as shears; a particle may have any speed;
tiles of cells inside the task blocks of 9.1 make the results independent of the blocks; there are three dimensions.
"""
