"""Navigation: orbit and attitude Kalman filters, boxes as measurements, burn errors."""
