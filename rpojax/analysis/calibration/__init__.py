"""Calibration of the statistical camera to the rendered camera and its detector."""
