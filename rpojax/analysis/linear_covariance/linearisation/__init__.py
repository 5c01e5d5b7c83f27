"""Linearisation of the closed loop: its deviation vector, Jacobians at every tick, and the error sources that drive it."""
