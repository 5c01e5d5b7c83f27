"""Trained networks and fitted camera statistics that a scenario refers to."""
