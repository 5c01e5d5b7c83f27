"""Triangle meshes: from files, of the packaged target, and random spacecraft."""
