"""Floor 3: offline training of the radiance field and the detector; optional packages only here."""
