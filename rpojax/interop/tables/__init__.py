"""Results of a campaign as tables with one number a cell, in files that other tools read."""
