"""Training and evaluation of a radiance field on ray-traced views."""
