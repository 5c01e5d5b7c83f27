"""Floor 4: the language of scenario files: schema, units, checks, and the parameters they become."""
