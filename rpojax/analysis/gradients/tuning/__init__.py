"""Tuning of the flight software by stochastic gradient descent on simulated runs."""
