"""ROS 2 messages, bags and DDS."""
