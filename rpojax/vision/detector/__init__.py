"""Two-stage detector of spacecraft: proposal network, refinement network, non-maximum suppression."""
