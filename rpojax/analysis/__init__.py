"""Floor 7: what many runs tell: statistics, linear covariance, gradients, reliability, calibration."""
