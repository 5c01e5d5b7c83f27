"""Mathematics shared by truth, sensors and flight software: frames, attitude, orbits, estimation, random numbers."""

import jax

# Dynamics and estimation need float64: orbit radii are 7000 km and errors are millimetres.
jax.config.update("jax_enable_x64", True)
