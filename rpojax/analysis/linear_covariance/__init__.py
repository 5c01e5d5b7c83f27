"""Linear covariance analysis of the closed loop: mean and covariance along a nominal run, without sampling."""
