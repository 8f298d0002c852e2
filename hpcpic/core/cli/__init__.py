"""WHICH VERB: the commands that every simulator answers."""
