"""Results and the live loop for other people's tools; their packages are optional and imported late."""
