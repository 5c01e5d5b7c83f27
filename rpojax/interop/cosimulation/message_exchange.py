"""All that a live run says and hears: messages out, commands in, each checked, and waited for no longer than agreed."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from rpojax.errors import RpojaxError
from rpojax.interop.cosimulation.command_checks import Reason
from rpojax.interop.cosimulation.event_log import Ledger
from rpojax.interop.ros2.dds_participant import Participant, Publisher, Subscriber
from rpojax.interop.ros2.message_builders import Said
from rpojax.interop.ros2.topics import Topic

T = TypeVar("T")
Check = Callable[[Any], T | Reason]

_SETTLED_S = 0.5
"""Discovery goes both ways: nobody is taken to be there before the number of listeners has stood still for so long."""
_LOOK_S = 0.05


class Heard:
    """One topic that commands come on.

    Attributes:
        received: messages so far
        newest: time of the newest command that counted [ns]
    """

    def __init__(self, topic: Topic, subscriber: Subscriber, ledger: Ledger) -> None:
        self.topic = topic
        self._subscriber, self._ledger = subscriber, ledger
        self._waiting: deque[Any] = deque()
        self.received = 0
        self.newest = -1

    @property
    def speakers(self) -> int:
        """How many publishers there are now."""
        return self._subscriber.speakers

    def command(self, at: int, exactly: bool, check: Check[T], until: float) -> tuple[int, T] | None:
        """Stamp [ns] and content of the command for the time `at` [ns], waited for until a monotonic time [s].

        Unless it is to be `exactly` that one, an older one that is new counts too, once nothing newer comes.
        """
        found: tuple[int, T] | None = None
        while True:
            while self._waiting or self._fetch():
                content = self._examine(self._waiting.popleft(), at, exactly, check)
                if content is not None:
                    found = self.newest, content
                    if self.newest == at:
                        return found
                # What has come together is looked at together, however late it is.
                if not self._waiting and time.monotonic() > until:
                    return found
            left = until - time.monotonic()
            if left <= 0.0 or not self._subscriber.wait(left):
                return found

    def _fetch(self) -> bool:
        taken = self._subscriber.arrived()
        self.received += len(taken)
        self._waiting.extend(taken)
        return bool(taken)

    def _examine(self, sample: Any, at: int, exactly: bool, check: Check[T]) -> T | None:
        """What a sample says, if it counts."""
        found = self._reason(sample.stamp, at, exactly)
        if found is None:
            message = sample.message
            found = Reason.UNREADABLE if message is None else check(message)
        if isinstance(found, Reason):
            self._ledger.ignore(self.topic, found)
            return None
        self.newest = sample.stamp
        return found

    def _reason(self, stamp: int | None, at: int, exactly: bool) -> Reason | None:
        """Why a stamp does not count."""
        if stamp is None:
            return Reason.UNREADABLE
        if stamp > at:
            return Reason.EARLY
        old = stamp < at if exactly else stamp <= self.newest
        return Reason.STALE if old or stamp == self.newest else None


class Exchange:
    """Publishers and subscribers of a run.

    Attributes:
        heard: topics that commands come on, by name
    """

    def __init__(self, domain_id: int, said: Sequence[Topic], heard: Sequence[Topic], ledger: Ledger) -> None:
        self._participant = Participant(domain_id)
        self._ledger, self._heard = ledger, tuple(heard)
        self._publishers: dict[str, Publisher] = {topic.name: self._participant.publisher(topic) for topic in said}
        self.heard = {topic.name: Heard(topic, self._participant.subscriber(topic), ledger) for topic in heard}

    def say(self, said: Said) -> None:
        """Sends messages on those of their topics that are this side's to speak on, where somebody listens."""
        for topic, make in said:
            publisher = self._publishers.get(topic.name)
            if publisher is not None and publisher.is_heard:
                publisher.send(make())

    def notice_strangers(self) -> None:
        """Counts publishers that have come to a topic of commands with another type than its own."""
        for topic, found in self._participant.strangers(self._heard):
            self._ledger.ignore(topic, f"{Reason.WRONG_TYPE} {found}")

    def meet(self, wait_s: float) -> None:
        """Waits until somebody speaks on every topic of commands, or, where there are none, anybody listens.

        For no time at all it does not wait, and minds nothing.

        Raises:
            RpojaxError: nobody has come in time.
        """
        until = time.monotonic() + wait_s
        listeners, since = -1, 0.0
        while wait_s > 0.0:
            missing = [heard.topic.name for heard in self.heard.values() if not heard.speakers]
            now, before = time.monotonic(), listeners
            listeners = sum(publisher.listeners for publisher in self._publishers.values())
            since = now if listeners != before else since
            if listeners and not missing and now - since >= _SETTLED_S:
                return
            if now > until:
                expected = f"a publisher on {missing[0]}" if missing else "a subscriber to any topic"
                raise RpojaxError(f"--wait-s: found nobody within {wait_s:g} s, expected {expected}")
            time.sleep(_LOOK_S)

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
        return {name: heard.received for name, heard in self.heard.items()}
