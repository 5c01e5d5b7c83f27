"""Dependence of a metric on the dispersed inputs: rank correlation, HSIC and two-sample tests."""
