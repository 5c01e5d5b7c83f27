"""Sensors that a scenario may have besides those of the packaged flight software, for replaced stages."""
