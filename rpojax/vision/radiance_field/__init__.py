"""Radiance field of a target: grid lookup, volume rendering, and images in a camera."""
