"""Case files: their grammar, schema, words and derived numbers."""
