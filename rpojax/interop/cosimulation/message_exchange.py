"""Publishers and command subscriptions of a live run."""

import time
from collections.abc import Sequence

from rpojax.errors import RpojaxError
from rpojax.interop.cosimulation.command_checks import RejectionReason
from rpojax.interop.cosimulation.command_subscription import CommandSubscription
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.ros2.dds_participant import Participant, Publisher
from rpojax.interop.ros2.tick_messages import TopicMessages
from rpojax.interop.ros2.topics import Topic

_DISCOVERY_SETTLE_S = 0.5
"""Time for which the number of subscribers must be constant before discovery counts as complete."""
_POLL_S = 0.05


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
            missing = [each.topic.name for each in self.subscriptions.values() if not each.publisher_count]
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
        return {name: each.received for name, each in self.subscriptions.items()}
