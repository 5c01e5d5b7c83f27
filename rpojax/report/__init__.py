"""Floor 7: results become pictures, one self-contained page for people and one JSON file for machines."""
