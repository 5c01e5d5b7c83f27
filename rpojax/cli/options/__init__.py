"""Options of commands, one record for each command: what its help shows, without JAX, NumPy or the work itself."""
