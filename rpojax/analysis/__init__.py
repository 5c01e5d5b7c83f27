"""Floor 6: what many runs say together; turns results of a campaign into statements about the design."""
