"""A mission of one's own from what is known: numbers of a scenario that fit each other, each with its reason."""
