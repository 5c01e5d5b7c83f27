"""ROS 2 message types as DDS sees them: classes for cyclonedds, made at run time from the same source as the bags'.

Nothing is generated ahead, and nothing is written down twice.
"""

from functools import cache, partial
from typing import Any, Literal

from rpojax.errors import RpojaxError
from rpojax.interop.ros2.message_types import deserialize, message_class, serialize, typestore
from rpojax.optional import require_package

_PRIMITIVE_TYPES = {
    "bool": "bool",
    "string": "str",
    # The same on the wire, but Cyclone DDS 0.10, which ROS 2 ships, cannot read a type description with `uint8`.
    **dict.fromkeys(("byte", "char", "octet", "uint8"), "byte"),
    **{name: name for name in ("int8", "int16", "int32", "int64", "uint16", "uint32", "uint64")},
    **{name: name for name in ("float32", "float64")},
}


def dds_type_name(name: str) -> str:
    """Name of a message type on the wire: `nav_msgs::msg::dds_::Odometry_` for `nav_msgs/msg/Odometry`."""
    package, kind, message = name.split("/")
    return f"{package}::{kind}::dds_::{message}_"


@cache
def idl_struct(name: str) -> Any:
    """The cyclonedds class of a message type, with the fields of the message.

    Raises:
        RpojaxError: cyclonedds or rosbags is not installed, or there is no such type.
    """
    idl = require_package("cyclonedds.idl", "ros")
    return idl.make_idl_struct(_class_name(name), _idl_name(name), _idl_fields(name))


@cache
def sample_class(name: str) -> Any:
    """The same type for messages of `message_class`: their bytes are those of the bags, and need no second copy.

    Of a sample that came, `stamp` is the time in its header [ns], read without the rest, which is read for `message`:
    a flood of old commands costs little. Both are None where the bytes are no such message.
    """
    idl = require_package("cyclonedds.idl", "ros")
    made = idl.make_idl_struct(_class_name(name), _idl_name(name), _idl_fields(name), dataclassify=False)
    # Not by inheritance: a base would become a part of the type on the wire.
    made.__init__ = _sample_init
    made.serialize = _serialize
    made.deserialize = classmethod(_deserialize)
    made.deserialize_key = classmethod(_deserialize_key)
    made.message = property(partial(_message, name))
    made.stamp = property(_header_stamp_ns)
    return made


def _sample_init(sample: Any, message: Any) -> None:
    sample.said, sample.data = message, None


def _serialize(sample: Any, **_: Any) -> bytes:
    return serialize(sample.said)


def _deserialize(made: Any, data: bytes, **_: Any) -> Any:
    sample = made(None)
    sample.data = bytes(data)
    return sample


def _deserialize_key(made: Any, data: bytes, **_: Any) -> Any:
    """What is said of a topic as a whole, such as its end, comes with a key; topics of ROS have none."""
    return made(None)


def _message(name: str, sample: Any) -> Any:
    try:
        return sample.said if sample.data is None else deserialize(sample.data, name)
    except (RpojaxError, UnicodeDecodeError):
        return None


def _header_stamp_ns(sample: Any) -> int | None:
    if sample.data is None or len(sample.data) < 12:
        return None
    # Four bytes of encapsulation, of which the second says which end comes first, then seconds and nanoseconds.
    byte_order: Literal["little", "big"] = "little" if sample.data[1] & 1 else "big"
    seconds = int.from_bytes(sample.data[4:8], byte_order, signed=True)
    return 10**9 * seconds + int.from_bytes(sample.data[8:12], byte_order)


def _idl_name(name: str) -> str:
    return dds_type_name(name).replace("::", ".")


def _class_name(name: str) -> str:
    return name.rpartition("/")[2] + "_"


def _idl_fields(name: str) -> dict[str, Any]:
    message_class(name)
    return {field: _idl_type(descriptor) for field, descriptor in typestore().fielddefs[name][1]}


def _idl_type(descriptor: Any) -> Any:
    types, kinds = require_package("cyclonedds.idl.types", "ros"), require_package("rosbags.interfaces", "ros").Nodetype
    kind, content = descriptor
    if kind == kinds.NAME:
        return idl_struct(content)
    if kind == kinds.BASE:
        base = _PRIMITIVE_TYPES[content[0]]
        return {"bool": bool, "str": str}.get(base) or getattr(types, base)
    element, size = content
    if kind == kinds.ARRAY:
        return types.array[_idl_type(element), size]
    return types.sequence[_idl_type(element), size] if size else types.sequence[_idl_type(element)]
