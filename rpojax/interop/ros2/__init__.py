"""ROS 2 messages, bags and a DDS participant."""
