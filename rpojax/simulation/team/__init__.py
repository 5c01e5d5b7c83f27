"""A team of servicers around one target: their parameters, state, and tick with what they send each other."""
