"""Mathematics shared by truth, sensors and flight software: frames, attitude, orbits, estimation, random numbers."""

from rpojax.runtime import jax_configuration

# Whatever computes imports this folder first.
jax_configuration.enable_double_precision()
