"""Starts of a scenario from orbit messages: an OEM, an OMM or two-line elements."""
