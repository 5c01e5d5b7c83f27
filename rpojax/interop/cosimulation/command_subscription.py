"""Subscription to one topic of commands: waits for a command, checks its stamp and content, counts rejections."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from rpojax.errors import RpojaxError
from rpojax.interop.cosimulation.command_checks import RejectionReason
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.ros2.dds_participant import Participant, Publisher, Subscriber
from rpojax.interop.ros2.message_builders import TopicMessages
from rpojax.interop.ros2.topics import Topic

T = TypeVar("T")
CommandCheck = Callable[[Any], T | RejectionReason]
"""Function that returns the content of a message, or why it is rejected."""
_DISCOVERY_SETTLE_S = 0.5
"""Time for which the number of subscribers must be constant before discovery counts as complete."""
_POLL_S = 0.05


class CommandSubscription:
    """Subscription to one topic of commands.

    Attributes:
        received: number of received messages
        latest_stamp_ns: stamp of the newest accepted command [ns]
    """

    def __init__(self, topic: Topic, subscriber: Subscriber, events: EventLog) -> None:
        self.topic = topic
        self._subscriber, self._events = subscriber, events
        self._pending: deque[Any] = deque()
        self.received = 0
        self.latest_stamp_ns = -1

    @property
    def publisher_count(self) -> int:
        """Number of current publishers."""
        return self._subscriber.publisher_count

    def wait_for_command(
        self, time_ns: int, exact_stamp: bool, check: CommandCheck[T], deadline: float
    ) -> tuple[int, T] | None:
        """Stamp [ns] and content of the command for simulation time `time_ns`, None if there is none by `deadline`.

        `deadline` is a monotonic time [s]. Without `exact_stamp`, a new command with an older stamp is accepted too,
        when no newer one arrives.
        """
        found: tuple[int, T] | None = None
        while True:
            while self._pending or self._fetch():
                content = self._examine(self._pending.popleft(), time_ns, exact_stamp, check)
                if content is not None:
                    found = self.latest_stamp_ns, content
                    if self.latest_stamp_ns == time_ns:
                        return found
                # Samples taken together are examined together, even beyond the deadline.
                if not self._pending and time.monotonic() > deadline:
                    return found
            remaining_s = deadline - time.monotonic()
            if remaining_s <= 0.0 or not self._subscriber.wait(remaining_s):
                return found

    def _fetch(self) -> bool:
        taken = self._subscriber.take_samples()
        self.received += len(taken)
        self._pending.extend(taken)
        return bool(taken)

    def _examine(self, sample: Any, time_ns: int, exact_stamp: bool, check: CommandCheck[T]) -> T | None:
        """Content of a sample, None if it is rejected."""
        found = self._stamp_rejection(sample.stamp_ns, time_ns, exact_stamp)
        if found is None:
            message = sample.message
            found = RejectionReason.UNREADABLE if message is None else check(message)
        if isinstance(found, RejectionReason):
            self._events.count_ignored(self.topic, found)
            return None
        self.latest_stamp_ns = sample.stamp_ns
        return found

    def _stamp_rejection(self, stamp: int | None, time_ns: int, exact_stamp: bool) -> RejectionReason | None:
        """Why a stamp is rejected, None if it is accepted."""
        if stamp is None:
            return RejectionReason.UNREADABLE
        if stamp > time_ns:
            return RejectionReason.EARLY
        old = stamp < time_ns if exact_stamp else stamp <= self.latest_stamp_ns
        return RejectionReason.STALE if old or stamp == self.latest_stamp_ns else None


class MessageExchange:
    """Publishers and subscribers of a run.

    Attributes:
        subscriptions: of the command topics, by topic name
    """

    def __init__(
        self, domain_id: int, published_topics: Sequence[Topic], command_topics: Sequence[Topic], events: EventLog
    ) -> None:
        self._participant = Participant(domain_id)
        self._events, self._command_topics = events, tuple(command_topics)
        self._publishers: dict[str, Publisher] = {
            topic.name: self._participant.publisher(topic) for topic in published_topics
        }
        self.subscriptions = {
            topic.name: CommandSubscription(topic, self._participant.subscriber(topic), events)
            for topic in command_topics
        }

    def publish(self, messages: TopicMessages) -> None:
        """Sends the messages on published topics that have subscribers."""
        for topic, build in messages:
            publisher = self._publishers.get(topic.name)
            if publisher is not None and publisher.is_needed:
                publisher.send(build())

    def count_type_mismatches(self) -> None:
        """Counts new publishers that joined a command topic with another message type."""
        for topic, found in self._participant.new_type_mismatches(self._command_topics):
            self._events.count_ignored(topic, f"{RejectionReason.WRONG_TYPE} {found}")

    def wait_for_nodes(self, wait_s: float) -> None:
        """Waits until every command topic has a publisher and there is a subscriber; returns at once if `wait_s` is 0.

        Raises:
            RpojaxError: this has not happened within `wait_s`.
        """
        deadline = time.monotonic() + wait_s
        subscribers, constant_since = -1, 0.0
        while wait_s > 0.0:
            missing = [
                subscription.topic.name
                for subscription in self.subscriptions.values()
                if not subscription.publisher_count
            ]
            now, before = time.monotonic(), subscribers
            subscribers = sum(publisher.subscriber_count for publisher in self._publishers.values())
            constant_since = now if subscribers != before else constant_since
            if subscribers and not missing and now - constant_since >= _DISCOVERY_SETTLE_S:
                return
            if now > deadline:
                expected = f"a publisher on {missing[0]}" if missing else "a subscriber to any topic"
                raise RpojaxError.of_argument("wait_s", f"found nobody within {wait_s:g} s, expected {expected}")
            time.sleep(_POLL_S)

    @property
    def sent(self) -> dict[str, int]:
        """Messages handed to DDS, by topic."""
        return {name: publisher.sent for name, publisher in self._publishers.items()}

    @property
    def unsent(self) -> int:
        """Number of messages that DDS did not accept in time."""
        return sum(publisher.unsent for publisher in self._publishers.values())

    @property
    def received(self) -> dict[str, int]:
        """Received messages, by topic."""
        return {name: subscription.received for name, subscription in self.subscriptions.items()}
