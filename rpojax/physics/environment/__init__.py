"""Environment: forces and torques of air, sunlight and the gravity gradient."""
