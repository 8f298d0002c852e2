"""The grains of a rank: contacts, films and motion."""
