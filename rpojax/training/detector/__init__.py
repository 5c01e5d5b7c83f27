"""Training of the detector: augmentation, losses, optimiser, calibration of its score."""
