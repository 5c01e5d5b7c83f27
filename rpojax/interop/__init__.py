"""Floor 8: runs in the formats of other tools (ROS 2, rerun) and live co-simulation; optional packages."""
