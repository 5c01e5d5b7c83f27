"""Warnings about a mission before it is simulated, one module each."""
