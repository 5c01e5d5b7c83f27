"""Floor 6: many runs through one compiled step, and the folder they leave."""
