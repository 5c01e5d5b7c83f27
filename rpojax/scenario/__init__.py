"""Floor 4: scenario files: schema, units, checks, and the static settings and parameters made from them."""
