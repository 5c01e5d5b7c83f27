"""Derivatives of runs: gradients and sensitivities of metrics, and tuning of flight software by gradient."""
