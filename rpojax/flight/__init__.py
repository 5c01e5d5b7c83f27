"""Floor 2: flight software. Sees measurements and its own models, never truth."""
