"""What a case file says: keys, units, words for one quantity."""
