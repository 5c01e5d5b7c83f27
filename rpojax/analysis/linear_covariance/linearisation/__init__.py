"""Linearisation of the closed loop: deviation vector, Jacobians at every tick, and the error sources that drive it."""
