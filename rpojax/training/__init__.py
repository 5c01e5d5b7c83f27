"""Floor 3: offline training of the radiance field and the detector, with optional packages."""
