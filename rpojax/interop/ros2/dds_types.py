"""DDS types of ROS 2 messages: cyclonedds classes, made at run time from the definitions in `message_types`."""

from functools import cache, partial
from typing import Any, Literal

from rpojax.errors import RpojaxError
from rpojax.interop.ros2.message_types import deserialize, message_class, serialize, typestore
from rpojax.optional_packages import require_package

_PRIMITIVE_TYPES = {
    "bool": "bool",
    "string": "str",
    # Equal on the wire; Cyclone DDS 0.10, which ROS 2 ships, cannot read a type description with `uint8`.
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
    """Cyclonedds class of a message type, with the fields of the message.

    Raises:
        RpojaxError: cyclonedds or rosbags is not installed, or there is no such type.
    """
    idl = require_package("cyclonedds.idl")
    return idl.make_idl_struct(_class_name(name), _idl_name(name), _idl_fields(name))


@cache
def sample_class(name: str) -> Any:
    """Cyclonedds class whose samples hold a `message_class` message, serialized as in bags, without a second copy.

    Of a received sample, `stamp_ns` is the time of its header and `message` the message, deserialized only when it is
    read, so that rejecting a command by its stamp costs little. Both are None where the bytes are no such message.
    """
    idl = require_package("cyclonedds.idl")
    created_class = idl.make_idl_struct(_class_name(name), _idl_name(name), _idl_fields(name), dataclassify=False)
    # Not by inheritance: a base class would become part of the DDS type.
    created_class.__init__ = _sample_init
    created_class.serialize = _serialize
    created_class.deserialize = classmethod(_deserialize)
    created_class.deserialize_key = classmethod(_deserialize_key)
    created_class.message = property(partial(_message, name))
    created_class.stamp_ns = property(_header_stamp_ns)
    return created_class


def _sample_init(sample: Any, message: Any) -> None:
    sample.sent, sample.received = message, None


def _serialize(sample: Any, **_: Any) -> bytes:
    return serialize(sample.sent)


def _deserialize(sample_type: Any, data: bytes, **_: Any) -> Any:
    sample = sample_type(None)
    sample.received = bytes(data)
    return sample


def _deserialize_key(sample_type: Any, data: bytes, **_: Any) -> Any:
    """Empty sample for the key that comes with notifications such as disposal; ROS topics have no keys."""
    return sample_type(None)


def _message(name: str, sample: Any) -> Any:
    try:
        return sample.sent if sample.received is None else deserialize(sample.received, name)
    except (RpojaxError, UnicodeDecodeError):
        return None


def _header_stamp_ns(sample: Any) -> int | None:
    if sample.received is None or len(sample.received) < 12:
        return None
    # Four bytes of encapsulation, the second of which is the byte order, then seconds and nanoseconds.
    byte_order: Literal["little", "big"] = "little" if sample.received[1] & 1 else "big"
    seconds = int.from_bytes(sample.received[4:8], byte_order, signed=True)
    return 10**9 * seconds + int.from_bytes(sample.received[8:12], byte_order)


def _idl_name(name: str) -> str:
    return dds_type_name(name).replace("::", ".")


def _class_name(name: str) -> str:
    return name.rpartition("/")[2] + "_"


def _idl_fields(name: str) -> dict[str, Any]:
    message_class(name)
    return {field: _idl_type(descriptor) for field, descriptor in typestore().fielddefs[name][1]}


def _idl_type(descriptor: Any) -> Any:
    types, kinds = require_package("cyclonedds.idl.types"), require_package("rosbags.interfaces").Nodetype
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
