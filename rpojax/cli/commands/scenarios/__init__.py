"""Commands for scenario files: a new one, its check and its schema."""
