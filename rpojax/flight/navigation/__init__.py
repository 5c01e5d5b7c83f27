"""Navigation: orbit and attitude Kalman filters, outlier gate, burn errors."""
