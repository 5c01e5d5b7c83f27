"""The controller of example_node.py as an rclpy node. Not tested: written without a ROS 2 installation.

    RMW_IMPLEMENTATION=rmw_cyclonedds_cpp ROS_DOMAIN_ID=0 python3 rclpy_node.py

It needs ROS 2 Humble or later and the imports of example_node.py; messages and transport are those of ROS. The DDS
settings for finding the simulator are in docs/how_to/ros2_live.md.
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
    """A ROS message; arrays become lists."""
    return ros_class(name)(
        **{field: value.tolist() if hasattr(value, "tolist") else value for field, value in fields.items()}
    )


class Adapter:
    """Interface of `ros_wire.Node` on an rclpy node."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.on_message: Callable[[str, Any], None] = lambda topic, message: None

    def subscribe(self, topic: str, name: str) -> None:
        """Subscribes to a topic."""
        self.node.create_subscription(ros_class(name), topic, lambda message: self.on_message(topic, message), 10)

    def publisher(self, topic: str, name: str) -> Callable[[Any], None]:
        """Function that publishes on a topic."""
        return self.node.create_publisher(ros_class(name), topic, 10).publish


def main() -> None:
    """Answers until it is interrupted."""
    rclpy.init()
    node = Node("rpojax_example", parameter_overrides=[rclpy.parameter.Parameter("use_sim_time", value=True)])
    example_node.make = make
    adapter: Any = Adapter(node)
    controller = Controller(adapter, {"formation", "attitude"})

    def on_message(topic: str, message: Any) -> None:
        controller.counts[topic] += 1
        controller.latest[topic] = message
        controller.answer()

    adapter.on_message = on_message
    assert set(controller.counts) == set(INTERFACE)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
