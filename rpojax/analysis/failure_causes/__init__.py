"""Why runs failed: rules over what is recorded of each run, and their ranking."""
