"""The fault matrix: every fault that a run must survive or tell, tried on a whole program."""
