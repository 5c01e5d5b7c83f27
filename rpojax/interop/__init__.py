"""Floor 8: runs in the formats of other tools (ROS 2, rerun) and live links; optional packages are imported late."""
