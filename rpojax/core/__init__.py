"""Floor 1: mathematics that all other floors share; knows nothing of vehicles, sensors or flight software."""

import jax

# Dynamics and estimation need float64: orbit radii are 7000 km and errors are millimetres.
jax.config.update("jax_enable_x64", True)
