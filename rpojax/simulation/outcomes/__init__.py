"""Outcomes of runs: how each ended, flags that were raised and cleared on the way, and freezing of failed runs."""
