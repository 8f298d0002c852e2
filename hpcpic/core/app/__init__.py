"""The face of a simulator to the commands, and helpers that several commands share."""
