"""Stand-ins for DDS subscribers whose messages are put in by a test."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.interop.cosimulation import command_checks, live_topics
from rpojax.interop.cosimulation.command_checks import CommandLimits, RejectionReason
from rpojax.interop.cosimulation.command_subscription import CommandSubscription
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.message_types import message_class
from rpojax.interop.ros2.topics import ECI

LIMITS = CommandLimits(torque=np.full(3, 0.025), minimum_on_time_s=0.5, maximum_on_time_s=110.0)
INSTANT_S = 1e-9
"""A timeout that is over at once."""


@dataclass
class Sample:
    """Sample as received from DDS; an unreadable one has no message."""

    message: Any

    @property
    def stamp_ns(self) -> int | None:
        return None if self.message is None else command_checks.header_stamp_ns(self.message)


class Inbox:
    """Subscriber that returns given batches of messages."""

    publisher_count = 1

    def __init__(self, *batches: list[Any]) -> None:
        self.batches = list(batches)

    def take_samples(self) -> list[Sample]:
        return list(map(Sample, self.batches.pop(0))) if self.batches else []

    def wait(self, seconds: float) -> bool:
        return bool(self.batches)


class InboxExchange:
    """Message exchange with an inbox for each command topic."""

    def __init__(self, events: EventLog, **batches: list[Any]) -> None:
        names = {"wheels": topics.WHEEL_COMMAND, "thruster": topics.THRUSTER_COMMAND}
        names |= {"target": live_topics.ATTITUDE_TARGET}
        self.subscriptions = {}
        for key, topic in names.items():
            inbox: Any = Inbox(batches.get(key, []))
            self.subscriptions[topic.name] = CommandSubscription(topic, inbox, events)


def wheel_subscription(*batches: list[Any]) -> tuple[CommandSubscription, EventLog]:
    """Subscription to wheel commands that receives given batches."""
    events = EventLog(lambda _: None)
    inbox: Any = Inbox(*batches)
    return CommandSubscription(topics.WHEEL_COMMAND, inbox, events), events


def torque_command(time_ns: int, size: float = 0.01) -> Any:
    """Command of one wheel."""
    return message_builders.wheel_command(time_ns, np.array([size, 0.0, 0.0]))


def attitude_target(time_ns: int, orientation: Any, frame_id: str = ECI) -> Any:
    """Attitude target of an orientation (x, y, z, w)."""
    return message_class("geometry_msgs/msg/QuaternionStamped")(
        header=message_builders.header_message(time_ns, frame_id),
        quaternion=message_builders.quaternion_message(np.asarray(orientation, dtype=np.float64)),
    )


def torque_size(message: Any) -> float | RejectionReason:
    """Check of a torque command that returns the torque of the first wheel."""
    found = command_checks.wheel_torque(message, LIMITS)
    return found if isinstance(found, RejectionReason) else float(found[0])


def rejections(events: EventLog) -> Counter[str]:
    """Number of ignored messages by reason."""
    return Counter({reason: count for (_, reason), count in events.ignored.items()})
