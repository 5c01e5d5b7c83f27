"""Warnings about a mission before it is simulated, one module each: no JAX, so that they take no time."""
