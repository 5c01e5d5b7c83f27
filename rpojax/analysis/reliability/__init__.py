"""First-order reliability: the most likely violation of a limit, searched with derivatives of runs."""
