"""ROS 2 message types: classes, serialization and type hashes, for bags and DDS.

The definitions are those of Jazzy, the release with the longest support. Every type in use has the same fields, hence
the same bytes and hash, in Humble and all later releases. `vision_msgs` is that of version 4.
"""

from functools import cache
from typing import TYPE_CHECKING, Any

from rpojax.errors import RpojaxError
from rpojax.optional_packages import require_package

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_VISION_MSGS_DEFINITIONS = {
    "Point2D": "float64 x\nfloat64 y",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "Detection2D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox2D bbox\nstring id",
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections",
}
"""Definitions of the `vision_msgs` 4 types that a detection consists of; rosbags does not bring them."""


@cache
def typestore() -> "Typestore":
    """Store of all known message types.

    Raises:
        RpojaxError: rosbags is not installed.
    """
    typesys = require_package("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for name, text in _VISION_MSGS_DEFINITIONS.items():
        store.register(typesys.get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    return store


@cache
def message_class(name: str) -> Any:
    """Class of a message type such as `nav_msgs/msg/Odometry`; its `__msgtype__` is that name.

    Raises:
        RpojaxError: there is no such type.
    """
    types = typestore().types
    if name not in types:
        raise RpojaxError(f"message type: found {name!r}, expected one such as 'nav_msgs/msg/Odometry'")
    return types[name]


def serialize(message: Any) -> bytes:
    """Little-endian CDR bytes of a message, with the encapsulation header of four bytes."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__, little_endian=True))


def deserialize(data: bytes | memoryview, name: str) -> Any:
    """Message of type `name` from its CDR bytes.

    Raises:
        RpojaxError: the bytes are no message of that type.
    """
    message_class(name)
    failure = require_package("rosbags.serde").SerdeError
    try:
        return typestore().deserialize_cdr(data, name)
    except failure as error:
        raise RpojaxError(f"{name}: found {len(data)} bytes that are not one ({error}), expected CDR") from None


def type_hash(name: str) -> str:
    """REP-2016 hash of a type, such as `RIHS01_3cc9...`, by which nodes check that their definitions agree."""
    message_class(name)
    return typestore().hash_rihs01(name)


def definition(name: str) -> str:
    """Text of a type and of all types that it contains, as stored in bags (`ros2msg`)."""
    message_class(name)
    return typestore().generate_msgdef(name, ros_version=2)[0]
