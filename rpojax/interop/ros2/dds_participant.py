"""DDS participant with the conventions of ROS 2: topics `rt/...`, types `pkg::msg::dds_::Name_`, type hashes.

Quality of service is reliable, volatile and keep last 10, the default of rclcpp and rclpy. Only the loopback interface
is used, unless the variable CYCLONEDDS_URI is set.
"""

import os
import time
from collections.abc import Sequence
from typing import Any

from rpojax.errors import RpojaxError
from rpojax.interop.ros2.dds_types import dds_type_name, sample_class
from rpojax.interop.ros2.message_types import type_hash
from rpojax.interop.ros2.topics import Topic
from rpojax.optional_packages import require_package

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


_configured_domains: dict[int, Any] = {}
"""Domains of this process by their id."""


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
