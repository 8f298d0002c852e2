"""Many runs of one scene: trade-offs, stability limits, sweeps."""
