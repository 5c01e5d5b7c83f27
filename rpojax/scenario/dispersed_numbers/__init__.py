"""Numbers of a scenario that vary from run to run: their keys, values of one run, standard normal variables."""
