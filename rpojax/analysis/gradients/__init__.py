"""Derivatives of runs, and tuning of flight software by gradient."""
