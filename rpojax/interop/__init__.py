"""Results and the live loop in the words of other tools: ROS 2 messages, frames and topics."""
