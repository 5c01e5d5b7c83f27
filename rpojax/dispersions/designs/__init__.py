"""Experiment designs: how the dispersed parameters are distributed over the runs of a campaign."""
