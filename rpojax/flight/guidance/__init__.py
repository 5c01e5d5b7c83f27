"""Guidance: burn timing, pointing at the target, slews, search."""
