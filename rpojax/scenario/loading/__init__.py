"""Loading of scenario files: TOML text, base scenarios, overrides and case tables."""
