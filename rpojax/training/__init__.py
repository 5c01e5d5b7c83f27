"""Floor 3: the offline phase, in which the networks of the camera are made; optional packages are needed only here."""
