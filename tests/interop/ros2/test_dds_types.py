"""DDS types: cyclonedds classes serialize to the bytes of the bags, for every known type."""

import itertools
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from experiment_modules import load_experiment

from rpojax.errors import RpojaxError
from rpojax.interop.ros2 import dds_participant, message_builders, message_types, topics

TYPES = sorted(message_types.typestore().types)
BASES = {"string": "text", "bool": True}


def both(name: str, numbers: Iterator[int]) -> tuple[Any, Any]:
    """A message with another number in every field, as rosbags and cyclonedds objects."""
    fields = message_types.typestore().fielddefs[name][1]
    pairs = {field: value(kind, numbers) for field, kind in fields}
    return (
        message_types.message_class(name)(**{field: pair[0] for field, pair in pairs.items()}),
        dds_participant.idl_struct(name)(**{field: pair[1] for field, pair in pairs.items()}),
    )


def value(descriptor: Any, numbers: Iterator[int]) -> tuple[Any, Any]:
    """Value of one field for both libraries; sequences have two elements."""
    kinds = import_module("rosbags.interfaces").Nodetype
    kind, what = descriptor
    if kind == kinds.NAME:
        return both(what, numbers)
    if kind == kinds.BASE:
        base = BASES.get(what[0], next(numbers) % 100)
        return (base, base)
    element, size = what
    count = size if kind == kinds.ARRAY else min(2, size or 2)
    pairs = [value(element, numbers) for _ in range(count)]
    first, second = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    if element[0] == kinds.BASE and element[1][0] != "string":
        dtype = {"bool": np.bool_, "byte": np.uint8, "octet": np.uint8, "char": np.uint8}.get(element[1][0])
        return np.array(first, dtype=dtype or element[1][0]), bytes(second) if is_byte(element) else second
    return first, second


def is_byte(element: Any) -> bool:
    return element[1][0] in ("uint8", "byte", "octet", "char")


@pytest.mark.parametrize("package", sorted({name.partition("/")[0] for name in TYPES}))
def test_every_type_of_a_package_has_equal_bytes_in_dds_and_bags(package: str) -> None:
    for name in (name for name in TYPES if name.startswith(f"{package}/")):
        message, sample = both(name, itertools.count(1))
        data = message_types.serialize(message)
        assert sample.serialize() == data, name
        assert dds_participant.idl_struct(name).deserialize(data).serialize() == data, name


def test_the_number_of_types_is_known() -> None:
    assert len(TYPES) == 169


def test_dds_type_names_are_those_of_ros_2() -> None:
    assert dds_participant.dds_type_name("nav_msgs/msg/Odometry") == "nav_msgs::msg::dds_::Odometry_"
    for made in (dds_participant.idl_struct, dds_participant.sample_class):
        assert made("nav_msgs/msg/Odometry").__idl_typename__ == "nav_msgs.msg.dds_.Odometry_"


def test_a_sample_round_trip_keeps_the_message() -> None:
    message = message_builders.wheel_command(1_200_000_000, np.array([0.1, -0.2, 0.3]))
    made = dds_participant.sample_class("sensor_msgs/msg/JointState")
    data = made(message).serialize()
    assert data == message_types.serialize(message)
    # DDS pads to whole words.
    again = made.deserialize(data + bytes(-len(data) % 4)).message
    assert again.header == message.header
    assert made.deserialize(data).stamp_ns == 1_200_000_000
    assert made.deserialize(b"\0\0\0\0" + b"\xff\xff\xff\xff\x00\x00\x00\x07").stamp_ns == 7 - 10**9
    assert made.deserialize(data[:11]).stamp_ns is None
    np.testing.assert_array_equal(again.effort, message.effort)


@pytest.mark.parametrize(
    "data", [b"", bytes(4), b"\0\1\0\0" + b"\xff" * 60, b"\0\1\0\0" + bytes(8) + b"\2\0\0\0\xff\0"]
)
def test_invalid_bytes_make_an_empty_sample(data: bytes) -> None:
    assert dds_participant.sample_class("sensor_msgs/msg/JointState").deserialize(data).message is None


def test_an_unknown_type_is_refused_in_one_line() -> None:
    with pytest.raises(RpojaxError, match=r"^message type: found 'nav_msgs/msg/Odometer', expected [^\n]*$"):
        dds_participant.idl_struct("nav_msgs/msg/Odometer")


def test_ros_wire_knows_the_types_of_all_topics() -> None:
    wire = load_experiment("ros2_interop/ros_wire.py")
    for name in {topic.type for topic in topics.ALL_TOPICS}:
        assert wire.struct(name).__idl_typename__ == dds_participant.dds_type_name(name).replace("::", ".")
        assert wire.STORE.hash_rihs01(name) == message_types.type_hash(name)
