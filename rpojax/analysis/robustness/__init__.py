"""Robustness: how far quantities that flight software believes may be off before a requirement breaks."""
