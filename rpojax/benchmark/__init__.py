"""Floor 7: what `rpojax bench` measures."""
