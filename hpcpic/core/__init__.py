"""The substrate shared by the simulators: it knows no physics."""
