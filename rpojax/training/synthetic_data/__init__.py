"""Synthetic data: meshes, ray-traced views, and composites with boxes."""
