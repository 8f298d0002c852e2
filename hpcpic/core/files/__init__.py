"""WHICH FILE: the run folder and what is in it.

folder       rundir.py, given.py (files of the case), provenance.py, start.py (arrays to start from)
in time      series.py, histograms.py, snapshot.py (VTKHDF), openpmd.py; parts.py names the files after a restart
checkpoint   sealed.py
writing      image.py lays out HDF5 in memory, arrays.py holds the part of a rank, together.py shares failures,
             atomic.py replaces a file as a whole
reading      reader.py, safe_hdf5.py
"""
