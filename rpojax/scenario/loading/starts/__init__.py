"""Starts of a scenario from orbit messages: an OEM, an OMM, an OPM or two-line elements."""
