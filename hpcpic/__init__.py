"""hpcpic: particle-and-grid simulators on one parallel substrate."""

__version__ = "0.1.0"
