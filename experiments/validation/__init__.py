"""Comparison of the plant with Basilisk, an independent simulator, on the same problems."""
