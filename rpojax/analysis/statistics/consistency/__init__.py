"""Consistency of a filter's covariance with its errors: NEES, NIS and whiteness of innovations."""
