"""Floor 9: the command line. Parses, calls, prints."""
