"""Floor 5: the numbers in which runs differ: their draws, designs of experiments, standard-normal space."""
