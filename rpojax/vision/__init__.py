"""Floor 2: from a scene to a picture, and from a picture to bounding boxes."""
