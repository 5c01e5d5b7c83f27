"""Floor 2: truth. Orbits, attitudes and actuators as they really are."""
