"""The controller of example_node.py as a node of rclpy. Not tried: no ROS 2 was at hand where it was written.

    RMW_IMPLEMENTATION=rmw_cyclonedds_cpp ROS_DOMAIN_ID=0 python3 rclpy_node.py

It needs ROS 2 Humble or later, and what example_node.py imports; messages and transport are those of ROS alone. The
settings with which DDS finds the simulator are in docs/ros2_live.md.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import example_node
import rclpy  # pyright: ignore[reportMissingImports]
from example_node import INTERFACE, Controller
from rclpy.node import Node  # pyright: ignore[reportMissingImports]


def ros_class(name: str) -> Any:
    """Class of a message type such as `nav_msgs/msg/Odometry`."""
    package, kind, short = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), short)


def make(name: str, /, **fields: Any) -> Any:
    """A message of ROS; its sequences take lists."""
    return ros_class(name)(
        **{field: value.tolist() if hasattr(value, "tolist") else value for field, value in fields.items()}
    )


class Adapter:
    """What the controller asks of a node, out of one of rclpy's."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.hear: Callable[[str, Any], None] = lambda topic, message: None

    def subscribe(self, topic: str, name: str) -> None:
        """Listens to a topic."""
        self.node.create_subscription(ros_class(name), topic, lambda message: self.hear(topic, message), 10)

    def publisher(self, topic: str, name: str) -> Callable[[Any], None]:
        """Speaks on a topic."""
        return self.node.create_publisher(ros_class(name), topic, 10).publish


def main() -> None:
    """Answers until it is interrupted."""
    rclpy.init()
    node = Node("rpojax_example", parameter_overrides=[rclpy.parameter.Parameter("use_sim_time", value=True)])
    example_node.make = make
    adapter: Any = Adapter(node)
    controller = Controller(adapter, {"formation", "attitude"})

    def hear(topic: str, message: Any) -> None:
        controller.counts[topic] += 1
        controller.latest[topic] = message
        controller.answer()

    adapter.hear = hear
    assert set(controller.counts) == set(INTERFACE)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
