"""The detector: proposal network, refinement network, non-maximum suppression."""
