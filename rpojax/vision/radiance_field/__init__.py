"""The radiance field of a target and its volume rendering."""
