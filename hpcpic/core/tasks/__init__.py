"""Task graphs: declared dependences, a compiled scheduler, pinned threads."""
