"""WHEN: the run loop, its triggers, guards, signals, checkpoints and summary."""
