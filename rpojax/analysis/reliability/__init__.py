"""First-order reliability (the most likely violation of a limit) and sensitivity from derivatives."""
