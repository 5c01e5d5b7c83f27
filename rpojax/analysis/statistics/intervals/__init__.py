"""Confidence intervals and bounds of probabilities, quantiles, means and standard deviations."""
