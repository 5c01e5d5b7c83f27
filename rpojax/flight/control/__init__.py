"""Control laws: the formation LQR, and attitude feedback with wheel torque allocation."""
