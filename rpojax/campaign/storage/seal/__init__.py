"""Seal of a campaign folder: digests that bind identity, blocks, histories and changes of requirements together."""
