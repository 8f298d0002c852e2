"""WHERE: domains, fields, records, random numbers and exact sums as plain arrays, without messages or files."""
