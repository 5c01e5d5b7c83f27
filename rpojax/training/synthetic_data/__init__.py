"""Synthetic data: meshes, ray-traced views, composites with boxes."""
