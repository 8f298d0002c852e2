"""From a case to the initial state."""
