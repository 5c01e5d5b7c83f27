"""DDS participant with the conventions of ROS 2: topics `rt/...`, types `pkg::msg::dds_::Name_`, type hashes.

Quality of service is reliable, volatile and keep last 10, the default of rclcpp and rclpy. Only the loopback interface
is used, unless the variable CYCLONEDDS_URI is set.
"""

import os
import time
from collections.abc import Sequence
from functools import cache, partial
from typing import Any, Literal

from rpojax.errors import RpojaxError
from rpojax.interop.ros2.message_types import deserialize, message_class, serialize, type_hash, typestore
from rpojax.interop.ros2.topics import Topic
from rpojax.optional_packages import require_package

_PRIMITIVE_TYPES = {
    "bool": "bool",
    "string": "str",
    # Equal on the wire; Cyclone DDS 0.10, which ROS 2 ships, cannot read a type description with `uint8`.
    **dict.fromkeys(("byte", "char", "octet", "uint8"), "byte"),
    **{name: name for name in ("int8", "int16", "int32", "int64", "uint16", "uint32", "uint64")},
    **{name: name for name in ("float32", "float64")},
}
LOOPBACK = (
    "<CycloneDDS><Domain>"
    '<General><Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast></General>'
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
    '<Peers><Peer address="127.0.0.1"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)
"""Settings without multicast and without any other interface."""
_BLOCKING_NS = 100_000_000
_RECEIVED_DEPTH = 20_000
"""More than the 10 of ROS, so that a flood of invalid messages does not push out valid ones."""
_LARGEST_DOMAIN_ID = 232
_MAX_SAMPLES_PER_TAKE = 64
_yield_processor = getattr(os, "sched_yield", lambda: None)
_SPIN_S = 0.002
"""Time for which a waiting thread polls before it sleeps, about the response time of a node: waking up is slow."""
_configured_domains: dict[int, Any] = {}
"""Domains of this process by their id."""


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


class Publisher:
    """Publisher of one topic.

    Attributes:
        sent: messages handed to DDS
        unsent: messages that DDS did not accept in time, because a subscriber had stopped reading
    """

    def __init__(self, participant: Any, topic: Topic) -> None:
        self._class = sample_class(topic.type)
        dds_topic = require_package("cyclonedds.topic").Topic(participant, _dds_topic_name(topic), self._class)
        self._writer = require_package("cyclonedds.pub").DataWriter(
            participant, dds_topic, _dds_qos(topic, topic.qos.depth)
        )
        self._failure = require_package("cyclonedds.core").DDSException
        self._latched = topic.qos.latched
        self.sent = 0
        self.unsent = 0

    def send(self, message: Any) -> None:
        """Sends one message to all subscribers."""
        try:
            self._writer.write(self._class(message))
        except self._failure:
            self.unsent += 1
        else:
            self.sent += 1

    @property
    def is_needed(self) -> bool:
        """Whether there is a subscriber, or late ones will get the last message."""
        return self._latched or self.subscriber_count > 0

    @property
    def subscriber_count(self) -> int:
        """Number of current subscribers."""
        return len(self._writer.get_matched_subscriptions())


class Subscriber:
    """Subscriber of one topic."""

    def __init__(self, participant: Any, topic: Topic) -> None:
        core = require_package("cyclonedds.core")
        dds_topic = require_package("cyclonedds.topic").Topic(
            participant, _dds_topic_name(topic), sample_class(topic.type)
        )
        self._reader = require_package("cyclonedds.sub").DataReader(
            participant, dds_topic, _dds_qos(topic, _RECEIVED_DEPTH)
        )
        any_data = core.ViewState.Any | core.InstanceState.Any | core.SampleState.NotRead
        self._condition = core.ReadCondition(self._reader, any_data)
        self._waitset = core.WaitSet(participant)
        self._waitset.attach(self._condition)
        self._invalid = require_package("cyclonedds.internal").InvalidSample

    def wait(self, timeout_s: float) -> bool:
        """Waits for a sample, for at most `timeout_s`, and returns whether there is one."""
        deadline = time.monotonic() + timeout_s
        spin_until = min(deadline, time.monotonic() + _SPIN_S)
        while time.monotonic() < spin_until:
            if self._waitset.wait(0) > 0:
                return True
            _yield_processor()
        return self._waitset.wait(max(round((deadline - time.monotonic()) * 1e9), 0)) > 0

    def take_samples(self) -> list[Any]:
        """Received samples, oldest first and at most 64, as instances of `sample_class`."""
        return [sample for sample in self._reader.take(_MAX_SAMPLES_PER_TAKE) if not isinstance(sample, self._invalid)]

    def take_messages(self) -> list[Any]:
        """Received messages, oldest first and at most 64; None for bytes that are no message of the topic's type."""
        return [sample.message for sample in self.take_samples()]

    @property
    def publisher_count(self) -> int:
        """Number of current publishers."""
        return len(self._reader.get_matched_publications())


class Participant:
    """DDS participant of one domain.

    Raises:
        RpojaxError: cyclonedds is not installed, or the domain cannot be joined.
    """

    def __init__(self, domain_id: int) -> None:
        if not 0 <= domain_id <= _LARGEST_DOMAIN_ID:
            raise RpojaxError.of_argument("domain_id", f"found {domain_id}, expected 0 to {_LARGEST_DOMAIN_ID}")
        domain, core = require_package("cyclonedds.domain"), require_package("cyclonedds.core")
        try:
            # The settings hold for the whole process, so they are made once for each domain.
            needs_settings = "CYCLONEDDS_URI" not in os.environ and domain_id not in _configured_domains
            if needs_settings:
                _configured_domains[domain_id] = domain.Domain(domain_id, LOOPBACK)
            self._participant = domain.DomainParticipant(domain_id)
        except core.DDSException as error:
            raise RpojaxError.of_argument(
                "domain_id", f"found no way to join {domain_id} ({error}), expected a domain"
            ) from None
        self._publications: Any = None
        self._known_mismatches: set[Any] = set()

    def publisher(self, topic: Topic) -> Publisher:
        """A publisher of a topic."""
        return Publisher(self._participant, topic)

    def subscriber(self, topic: Topic) -> Subscriber:
        """A subscriber to a topic."""
        return Subscriber(self._participant, topic)

    def new_type_mismatches(self, topics: Sequence[Topic]) -> list[tuple[Topic, str]]:
        """Publishers that have newly joined one of the topics with another message type: topic and that type."""
        builtin = require_package("cyclonedds.builtin")
        if self._publications is None:
            self._publications = builtin.BuiltinDataReader(self._participant, builtin.BuiltinTopicDcpsPublication)
        names = {_dds_topic_name(topic): topic for topic in topics}
        mismatches = []
        for publication in self._publications.take(_MAX_SAMPLES_PER_TAKE):
            topic = names.get(publication.topic_name)
            # A publisher that leaves is reported a second time.
            if (
                topic is not None
                and publication.type_name != dds_type_name(topic.type)
                and publication.key not in self._known_mismatches
            ):
                self._known_mismatches.add(publication.key)
                mismatches.append((topic, publication.type_name))
        return mismatches


def _dds_topic_name(topic: Topic) -> str:
    return "rt" + topic.name


def _dds_qos(topic: Topic, depth: int) -> Any:
    qos = require_package("cyclonedds.qos")
    policy = qos.Policy
    return qos.Qos(
        policy.Reliability.Reliable(_BLOCKING_NS),
        policy.Durability.TransientLocal if topic.qos.latched else policy.Durability.Volatile,
        policy.History.KeepLast(depth),
        policy.Userdata(f"typehash={type_hash(topic.type)};".encode()),
    )
