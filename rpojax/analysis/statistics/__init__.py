"""Statistics of independent runs: intervals, verdicts on requirements, filter consistency, sensitivity, comparison."""
