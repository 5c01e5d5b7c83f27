"""Floor 1: everything process-wide: JAX environment, compiler options, caches, devices."""
