"""Guidance: burn planning, target pointing, slews, target acquisition and search."""
