"""Rare events: probability of failure by subset simulation, importance, line and plain sampling, and their choice."""
