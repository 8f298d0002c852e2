"""The particles of a rank: storage, neighbours, exchanges and sums."""
