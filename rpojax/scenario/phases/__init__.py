"""Schema of the phases of a mission and of their reference trajectories."""
