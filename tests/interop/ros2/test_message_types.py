"""Message types: type hashes, serialized bytes, and equality over ROS 2 releases."""

import struct
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from rpojax.errors import RpojaxError
from rpojax.interop.ros2 import message_builders, message_types
from rpojax.interop.ros2.topics import ALL_TOPICS

TYPES = sorted({topic.type for topic in ALL_TOPICS})


def test_the_type_hash_of_odometry_is_that_of_ros_2() -> None:
    known = "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"
    assert message_types.type_hash("nav_msgs/msg/Odometry") == known


@pytest.mark.parametrize("release", ["ROS2_HUMBLE", "ROS2_IRON", "ROS2_JAZZY", "ROS2_KILTED", "LATEST"])
def test_every_used_type_is_equal_in_all_releases(release: str) -> None:
    typesys = import_module("rosbags.typesys")
    other = typesys.get_typestore(typesys.Stores[release])
    for name in TYPES:
        if not name.startswith("vision_msgs/"):
            assert other.hash_rihs01(name) == message_types.type_hash(name), name


def test_the_definition_of_a_detection_contains_its_nested_types() -> None:
    text = message_types.definition("vision_msgs/msg/Detection2DArray")
    assert text.startswith("std_msgs/Header header\nvision_msgs/Detection2D[] detections\n")
    assert "MSG: vision_msgs/Point2D\nfloat64 x\nfloat64 y" in text


def test_serialized_bytes_are_cdr() -> None:
    data = message_types.serialize(message_builders.gps(1_500_000_000, np.array([1.0, -2.0, 3.0])))
    # Little-endian CDR: seconds, nanoseconds, length and text of the frame id; doubles at multiples of eight.
    assert data == b"\0\1\0\0" + struct.pack("<iII4s3d", 1, 500_000_000, 4, b"eci\0", 1.0, -2.0, 3.0)
    assert message_types.deserialize(data, "geometry_msgs/msg/PointStamped").point.y == -2.0


@pytest.mark.parametrize("function", [message_types.message_class, message_types.type_hash, message_types.definition])
def test_an_unknown_type_is_refused_in_one_line(function: Any) -> None:
    with pytest.raises(RpojaxError, match=r"^message type: found 'nav_msgs/Odometry', expected one such as '[^\n]*$"):
        function("nav_msgs/Odometry")


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0\1", b"\7\7\0\0" + bytes(24), bytes(4) + b"\xff" * 40])
def test_invalid_bytes_are_refused_in_one_line(data: bytes) -> None:
    with pytest.raises(RpojaxError, match=rf"^geometry_msgs/msg/PointStamped: found {len(data)} bytes[^\n]*$"):
        message_types.deserialize(data, "geometry_msgs/msg/PointStamped")
