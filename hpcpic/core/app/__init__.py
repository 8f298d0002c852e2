"""What a simulator tells the commands, and what commands share."""
