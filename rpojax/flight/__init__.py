"""Floor 2: flight software. It uses measurements and its own models, never truth."""
