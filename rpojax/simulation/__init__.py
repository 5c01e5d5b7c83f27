"""Floor 4: a scenario becomes arrays, and arrays become a closed-loop run."""
