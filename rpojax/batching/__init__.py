"""Floor 1: batches of runs along the last axis of every array."""
