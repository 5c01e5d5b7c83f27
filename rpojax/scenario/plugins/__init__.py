"""Plugins: metrics, sensors and stages of a user, from a Python file or from Python, for one scenario."""
