"""Navigation: orbit and attitude Kalman filters, outlier gate, thrust estimator."""
