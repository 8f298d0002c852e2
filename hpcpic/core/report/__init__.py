"""Figures, pages and exports of runs."""
