"""Floor 3: the only place where truth becomes a measurement."""
