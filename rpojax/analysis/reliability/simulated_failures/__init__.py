"""Simulated failures: probability that runs of a scenario break a limit, in a folder from which it can be resumed."""
