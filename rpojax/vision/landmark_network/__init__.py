"""Network that finds the landmarks of a target in a crop of a picture."""
