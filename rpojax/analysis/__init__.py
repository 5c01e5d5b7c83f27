"""Analysis of runs: statistics, linear covariance, gradients and tuning, reliability, camera calibration."""
