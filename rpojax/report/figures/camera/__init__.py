"""Annotated camera images, contact sheets and films of one run."""
