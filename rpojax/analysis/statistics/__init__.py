"""Statistics of runs: intervals, verdicts on requirements, filter consistency, dependence, paired comparison."""
