"""Inspection coverage in the report: what was seen of the target's surface, and a picture of it."""
