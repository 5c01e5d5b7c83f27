"""Training and evaluation of the network that finds landmarks."""
