"""Floor 5: dispersed parameters of the runs of a campaign: distributions, experiment designs, standard-normal space."""
