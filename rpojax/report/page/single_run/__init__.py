"""Single runs in the report: worst beside median, timeline, channels over time, burns, camera boxes, relative path."""
