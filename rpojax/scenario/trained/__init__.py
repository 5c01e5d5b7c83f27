"""Files that a scenario refers to: trained networks, fitted camera statistics, and the mesh of the target's surface."""
