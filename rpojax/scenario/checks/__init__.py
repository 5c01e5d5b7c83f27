"""Checks of a scenario that span several keys, and faults of its schema as one line."""
