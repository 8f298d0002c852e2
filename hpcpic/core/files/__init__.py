"""WHICH FILE: case files, run folders, series and snapshots."""
