"""Rare failures in the report: estimated probabilities, and requirements that plain runs cannot verify."""
