"""Monte Carlo campaigns: many dispersed runs through one compiled step, and the folder with their results."""
