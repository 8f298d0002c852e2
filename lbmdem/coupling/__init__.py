"""What fluid and grains do to each other."""
