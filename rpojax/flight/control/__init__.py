"""Control: formation LQR, station keeping, attitude feedback and wheel torque allocation."""
