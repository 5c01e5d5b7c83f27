"""Fits of the statistical camera to the rendered one."""
