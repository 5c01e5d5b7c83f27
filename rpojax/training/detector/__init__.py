"""Training of the detector: augmentation, losses, optimiser, evaluation."""
