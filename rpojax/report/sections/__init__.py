"""Sections of the report, one module each: what they say, from the results of a campaign."""
