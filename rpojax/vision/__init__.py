"""Floor 2: images of a target from a radiance field, and bounding boxes of spacecraft in images."""
