"""ROS 2 topics without ROS, on cyclonedds and rosbags alone; meant to be copied, independent of rpojax."""

import os
from collections.abc import Iterator
from functools import cache
from typing import Any

from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<MaxAutoParticipantIndex>30</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)
VISION = {
    "Point2D": "float64 x\nfloat64 y",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "Detection2D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox2D bbox\nstring id",
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections",
}
"""Definitions of vision_msgs 4, for `/servicer/camera/detections`; rosbags does not bring them."""
STORE = get_typestore(Stores.ROS2_JAZZY)
for short, text in VISION.items():
    STORE.register(get_types_from_msg(text, f"vision_msgs/msg/{short}"))
RELIABLE = Policy.Reliability.Reliable(100_000_000)
ANY_STATE = ViewState.Any | InstanceState.Any | SampleState.NotRead


def make(name: str, /, **fields: Any) -> Any:
    """A message, such as `make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)`."""
    kind: Any = STORE.types[name]
    return kind(**fields)


@cache
def struct(name: str) -> Any:
    """DDS type whose samples hold a message that rosbags serializes."""
    package, kind, short = name.split("/")
    fields = {field: _type(what) for field, what in STORE.fielddefs[name][1]}
    made: Any = make_idl_struct(f"{short}_", f"{package}.{kind}.dds_.{short}_", fields, dataclassify=False)
    made.__init__ = lambda sample, message: setattr(sample, "message", message)
    made.serialize = lambda sample, **_: bytes(STORE.serialize_cdr(sample.message, name))

    def read(cls: Any, data: bytes, **_: Any) -> Any:
        return cls(STORE.deserialize_cdr(data, name))

    def read_key(cls: Any, data: bytes, **_: Any) -> Any:
        return cls(None)

    made.deserialize, made.deserialize_key = classmethod(read), classmethod(read_key)
    return made


def _type(descriptor: Any) -> Any:
    kind, what = descriptor
    if kind == Nodetype.NAME:
        return struct(what)
    if kind == Nodetype.BASE:
        bytes_ = dict.fromkeys(("octet", "char", "uint8", "byte"), types.byte)
        other = {"bool": bool, "string": str, **bytes_}
        return other.get(what[0]) or getattr(types, what[0])
    element, size = what
    if kind == Nodetype.ARRAY:
        return types.array[_type(element), size]
    return types.sequence[_type(element), size] if size else types.sequence[_type(element)]


class Node:
    """DDS participant with publishers and subscriptions, like a ROS node."""

    def __init__(self, domain_id: int = 0) -> None:
        self._domain = None if "CYCLONEDDS_URI" in os.environ else Domain(domain_id, LOOPBACK)
        self._participant = DomainParticipant(domain_id)
        self._waitset = WaitSet(self._participant)
        self._readers: dict[str, DataReader] = {}

    def subscribe(self, topic: str, name: str) -> None:
        """Subscribes to a topic."""
        reader = DataReader(self._participant, Topic(self._participant, "rt" + topic, struct(name)), _qos(name, 100))
        self._waitset.attach(ReadCondition(reader, ANY_STATE))
        self._readers[topic] = reader

    def publisher(self, topic: str, name: str) -> Any:
        """Function that sends a message of a type on a topic."""
        made = struct(name)
        writer = DataWriter(self._participant, Topic(self._participant, "rt" + topic, made), _qos(name, 10))
        return lambda message: writer.write(made(message))

    def take(self, seconds: float) -> list[tuple[str, Any]]:
        """Messages received on all topics within a time [s]; oldest first for each topic."""
        self._waitset.wait(round(seconds * 1e9))
        taken = ((topic, sample) for topic, reader in self._readers.items() for sample in reader.take(100))
        return [(topic, sample.message) for topic, sample in taken if getattr(sample, "message", None) is not None]

    def messages(self, patience_s: float) -> Iterator[tuple[str, Any]]:
        """Messages of all topics, until their publishers have left or there was none for `patience_s` [s]."""
        silent, started = 0.0, False
        while silent < patience_s and not (started and silent and all(map(self.has_no_publisher, self._readers))):
            received = self.take(0.5)
            silent = 0.0 if received else silent + 0.5
            started = started or bool(received)
            yield from received

    def has_no_publisher(self, topic: str) -> bool:
        """Whether a subscribed topic has no publisher."""
        return not self._readers[topic].get_matched_publications()


def _qos(name: str, depth: int) -> Qos:
    hash_ = f"typehash={STORE.hash_rihs01(name)};".encode()
    return Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(depth), Policy.Userdata(hash_))
