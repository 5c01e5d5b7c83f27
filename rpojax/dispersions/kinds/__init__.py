"""Kinds of dispersion, one module each: schema, checks, draw, marginal distributions and linearisation."""
