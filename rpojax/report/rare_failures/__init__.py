"""Rare failures in the report: probabilities from `rpojax probability`, and requirements that plain runs cannot verify."""
