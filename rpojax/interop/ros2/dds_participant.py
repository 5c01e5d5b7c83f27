"""A DDS participant that speaks as ROS 2 nodes do: topics `rt/...`, types `pkg::msg::dds_::Name_`, type hashes.

Reliable and volatile, the last ten kept, as rclcpp and rclpy have it by default. It stays on the loopback interface
unless the variable CYCLONEDDS_URI says otherwise.
"""

import os
import time
from collections.abc import Sequence
from typing import Any

from rpojax.errors import RpojaxError
from rpojax.interop.ros2.dds_types import dds_name, wire_class
from rpojax.interop.ros2.message_types import type_hash
from rpojax.interop.ros2.topics import Topic
from rpojax.optional import need

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
"""A subscriber keeps more than ROS's ten, so that a flood of nonsense does not push out what counts."""
_HIGHEST_DOMAIN = 232
_AT_ONCE = 64
_let_others = getattr(os, "sched_yield", lambda: None)
_AWAKE_S = 0.002
"""A thread that sleeps until a message comes is woken late: for about as long as a node thinks it stays awake."""


class Publisher:
    """One topic that this participant speaks on.

    Attributes:
        sent: messages given to DDS
        unsent: messages that DDS did not take in time, as a subscriber had stopped to read
    """

    def __init__(self, participant: Any, topic: Topic) -> None:
        self._class = wire_class(topic.type)
        made = need("cyclonedds.topic", "ros").Topic(participant, _wire_name(topic), self._class)
        self._writer = need("cyclonedds.pub", "ros").DataWriter(participant, made, _qos(topic, topic.qos.depth))
        self._failure = need("cyclonedds.core", "ros").DDSException
        self._latched = topic.qos.latched
        self.sent = 0
        self.unsent = 0

    def send(self, message: Any) -> None:
        """Sends one message to all who listen."""
        try:
            self._writer.write(self._class(message))
        except self._failure:
            self.unsent += 1
        else:
            self.sent += 1

    @property
    def is_heard(self) -> bool:
        """Somebody listens, or will be given what was said before."""
        return self._latched or self.listeners > 0

    @property
    def listeners(self) -> int:
        """How many subscribers there are now."""
        return len(self._writer.get_matched_subscriptions())


class Subscriber:
    """One topic that this participant listens to."""

    def __init__(self, participant: Any, topic: Topic) -> None:
        core = need("cyclonedds.core", "ros")
        made = need("cyclonedds.topic", "ros").Topic(participant, _wire_name(topic), wire_class(topic.type))
        self._reader = need("cyclonedds.sub", "ros").DataReader(participant, made, _qos(topic, _RECEIVED_DEPTH))
        any_data = core.ViewState.Any | core.InstanceState.Any | core.SampleState.NotRead
        self._condition = core.ReadCondition(self._reader, any_data)
        self._waitset = core.WaitSet(participant)
        self._waitset.attach(self._condition)
        self._invalid = need("cyclonedds.internal", "ros").InvalidSample

    def wait(self, seconds: float) -> bool:
        """Waits until something has come, for at most so many seconds; tells whether it has."""
        until = time.monotonic() + seconds
        asleep = min(until, time.monotonic() + _AWAKE_S)
        while time.monotonic() < asleep:
            if self._waitset.wait(0) > 0:
                return True
            _let_others()
        return self._waitset.wait(max(round((until - time.monotonic()) * 1e9), 0)) > 0

    def arrived(self) -> list[Any]:
        """Some of the samples that have come, oldest first, as `wire_class` makes them."""
        return [sample for sample in self._reader.take(_AT_ONCE) if not isinstance(sample, self._invalid)]

    def take(self) -> list[Any]:
        """Some of the messages that have come, oldest first; None for one that is no message of the topic's type."""
        return [sample.message for sample in self.arrived()]

    @property
    def speakers(self) -> int:
        """How many publishers there are now."""
        return len(self._reader.get_matched_publications())


class Participant:
    """A participant of one domain, and all that it says and hears.

    Raises:
        RpojaxError: cyclonedds is not installed, or the domain cannot be joined.
    """

    def __init__(self, domain_id: int) -> None:
        if not 0 <= domain_id <= _HIGHEST_DOMAIN:
            raise RpojaxError(f"--domain-id: found {domain_id}, expected 0 to {_HIGHEST_DOMAIN}")
        domain, core = need("cyclonedds.domain", "ros"), need("cyclonedds.core", "ros")
        try:
            # The settings hold for the whole process: who joins the domain a second time finds them made.
            first = "CYCLONEDDS_URI" not in os.environ and domain_id not in _domains
            if first:
                _domains[domain_id] = domain.Domain(domain_id, LOOPBACK)
            self._participant = domain.DomainParticipant(domain_id)
        except core.DDSException as error:
            raise RpojaxError(f"--domain-id: found no way to join {domain_id} ({error}), expected a domain") from None
        self._publications: Any = None
        self._strangers: set[Any] = set()

    def publisher(self, topic: Topic) -> Publisher:
        """A publisher of a topic."""
        return Publisher(self._participant, topic)

    def subscriber(self, topic: Topic) -> Subscriber:
        """A subscriber to a topic."""
        return Subscriber(self._participant, topic)

    def strangers(self, topics: Sequence[Topic]) -> list[tuple[Topic, str]]:
        """Publishers that have newly come to one of some topics with another type than the topic's, which is told."""
        builtin = need("cyclonedds.builtin", "ros")
        if self._publications is None:
            self._publications = builtin.BuiltinDataReader(self._participant, builtin.BuiltinTopicDcpsPublication)
        names = {_wire_name(topic): topic for topic in topics}
        found = []
        for end in self._publications.take(_AT_ONCE):
            topic = names.get(end.topic_name)
            # One that goes away is told of once more.
            if topic is not None and end.type_name != dds_name(topic.type) and end.key not in self._strangers:
                self._strangers.add(end.key)
                found.append((topic, end.type_name))
        return found


_domains: dict[int, Any] = {}
"""Domains of this process by their number."""


def _wire_name(topic: Topic) -> str:
    return "rt" + topic.name


def _qos(topic: Topic, depth: int) -> Any:
    qos = need("cyclonedds.qos", "ros")
    policy = qos.Policy
    return qos.Qos(
        policy.Reliability.Reliable(_BLOCKING_NS),
        policy.Durability.TransientLocal if topic.qos.latched else policy.Durability.Volatile,
        policy.History.KeepLast(depth),
        policy.Userdata(f"typehash={type_hash(topic.type)};".encode()),
    )
