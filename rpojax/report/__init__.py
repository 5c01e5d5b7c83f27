"""Floor 8: results as figures, one self-contained page for people and one JSON file for machines."""
