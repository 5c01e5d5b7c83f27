"""Floor 2: truth. Orbits, attitudes, environment, actuators and equipment faults."""
