"""Numbers of a scenario: their units, sections whose keys they are, and the records that sections become."""
