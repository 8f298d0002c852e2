"""After a run: theory, experiments and figures."""
