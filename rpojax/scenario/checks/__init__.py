"""Checks of a scenario that span several keys."""
