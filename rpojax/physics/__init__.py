"""Floor 2: truth. Orbits, attitudes, environment and actuators as they really are."""
