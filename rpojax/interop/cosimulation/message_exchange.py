"""All that a live run says and hears: messages out, commands in, each checked, and waited for no longer than agreed."""

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

_DISCOVERY_SETTLE_S = 0.5
"""Discovery goes both ways: nobody is taken to be there before the number of listeners has stood still for so long."""
_POLL_S = 0.05


class CommandSubscription:
    """One topic that commands come on.

    Attributes:
        received: messages so far
        newest: time of the newest command that counted [ns]
    """

    def __init__(self, topic: Topic, subscriber: Subscriber, events: EventLog) -> None:
        self.topic = topic
        self._subscriber, self._events = subscriber, events
        self._pending: deque[Any] = deque()
        self.received = 0
        self.latest_stamp_ns = -1

    @property
    def publisher_count(self) -> int:
        """How many publishers there are now."""
        return self._subscriber.publisher_count

    def wait_for_command(
        self, time_ns: int, exact_stamp: bool, check: CommandCheck[T], deadline: float
    ) -> tuple[int, T] | None:
        """Stamp [ns] and content of the command for the time `at` [ns], waited for until a monotonic time [s].

        Unless it is to be `exactly` that one, an older one that is new counts too, once nothing newer comes.
        """
        found: tuple[int, T] | None = None
        while True:
            while self._pending or self._fetch():
                content = self._examine(self._pending.popleft(), time_ns, exact_stamp, check)
                if content is not None:
                    found = self.latest_stamp_ns, content
                    if self.latest_stamp_ns == time_ns:
                        return found
                # What has come together is looked at together, however late it is.
                if not self._pending and time.monotonic() > deadline:
                    return found
            left = deadline - time.monotonic()
            if left <= 0.0 or not self._subscriber.wait(left):
                return found

    def _fetch(self) -> bool:
        taken = self._subscriber.take_samples()
        self.received += len(taken)
        self._pending.extend(taken)
        return bool(taken)

    def _examine(self, sample: Any, time_ns: int, exact_stamp: bool, check: CommandCheck[T]) -> T | None:
        """What a sample says, if it counts."""
        found = self._stamp_rejection(sample.stamp, time_ns, exact_stamp)
        if found is None:
            message = sample.message
            found = RejectionReason.UNREADABLE if message is None else check(message)
        if isinstance(found, RejectionReason):
            self._events.count_ignored(self.topic, found)
            return None
        self.latest_stamp_ns = sample.stamp
        return found

    def _stamp_rejection(self, stamp: int | None, time_ns: int, exact_stamp: bool) -> RejectionReason | None:
        """Why a stamp does not count."""
        if stamp is None:
            return RejectionReason.UNREADABLE
        if stamp > time_ns:
            return RejectionReason.EARLY
        old = stamp < time_ns if exact_stamp else stamp <= self.latest_stamp_ns
        return RejectionReason.STALE if old or stamp == self.latest_stamp_ns else None


class MessageExchange:
    """Publishers and subscribers of a run.

    Attributes:
        heard: topics that commands come on, by name
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
        """Sends messages on those of their topics that are this side's to speak on, where somebody listens."""
        for topic, make in messages:
            publisher = self._publishers.get(topic.name)
            if publisher is not None and publisher.is_needed:
                publisher.send(make())

    def count_type_mismatches(self) -> None:
        """Counts publishers that have come to a topic of commands with another type than its own."""
        for topic, found in self._participant.new_type_mismatches(self._command_topics):
            self._events.count_ignored(topic, f"{RejectionReason.WRONG_TYPE} {found}")

    def wait_for_nodes(self, wait_s: float) -> None:
        """Waits until somebody speaks on every topic of commands, or, where there are none, anybody listens.

        For no time at all it does not wait, and minds nothing.

        Raises:
            RpojaxError: nobody has come in time.
        """
        until = time.monotonic() + wait_s
        listeners, since = -1, 0.0
        while wait_s > 0.0:
            missing = [heard.topic.name for heard in self.subscriptions.values() if not heard.publisher_count]
            now, before = time.monotonic(), listeners
            listeners = sum(publisher.subscriber_count for publisher in self._publishers.values())
            since = now if listeners != before else since
            if listeners and not missing and now - since >= _DISCOVERY_SETTLE_S:
                return
            if now > until:
                expected = f"a publisher on {missing[0]}" if missing else "a subscriber to any topic"
                raise RpojaxError(f"--wait-s: found nobody within {wait_s:g} s, expected {expected}")
            time.sleep(_POLL_S)

    @property
    def sent(self) -> dict[str, int]:
        """Messages given to DDS, by topic."""
        return {name: publisher.sent for name, publisher in self._publishers.items()}

    @property
    def unsent(self) -> int:
        """Messages that DDS did not take in time."""
        return sum(publisher.unsent for publisher in self._publishers.values())

    @property
    def received(self) -> dict[str, int]:
        """Messages that have come, by topic."""
        return {name: heard.received for name, heard in self.subscriptions.items()}
