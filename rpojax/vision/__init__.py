"""Floor 2: what a camera makes of a scene."""
