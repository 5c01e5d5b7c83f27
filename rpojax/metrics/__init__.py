"""Metrics of runs: one definition each, and its reduction over time, from records or during the simulation."""
