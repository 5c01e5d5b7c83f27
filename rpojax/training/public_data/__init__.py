"""Labelled pictures of public data sets, read from folders as they are distributed."""
