"""Runs in the words of other tools, ROS 2 and the rerun viewer; their packages are optional and imported late."""
