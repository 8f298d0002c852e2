"""The version, which files and pages tell."""

__version__ = "0.1.0"
