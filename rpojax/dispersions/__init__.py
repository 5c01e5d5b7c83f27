"""Floor 3: kinds of dispersion about a nominal value, sources of their random numbers, and experiment designs."""
