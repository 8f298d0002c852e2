"""What is measured and watched while a run goes: scalars, gauges, snapshots, guards."""
