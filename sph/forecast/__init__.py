"""Before a run: derived numbers, plan, estimate, knobs and the rates of this machine."""
