"""Live co-simulation: a run that exchanges messages with ROS 2 nodes tick by tick."""
