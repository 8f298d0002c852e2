"""WHERE: domains, fields, particles, cells and shapes as plain arrays, without messages or files."""
