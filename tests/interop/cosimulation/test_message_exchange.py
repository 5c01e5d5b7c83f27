"""Message exchange over DDS on the loopback interface."""

from functools import partial

import numpy as np
import pytest
from command_inbox import rejections, torque_command, torque_size

from rpojax.errors import RpojaxError
from rpojax.interop.cosimulation.clock import LockstepClock
from rpojax.interop.cosimulation.command_subscription import MessageExchange
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.dds_participant import Participant
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S as NANO
from rpojax.interop.ros2.topics import Topic, TopicRate, TopicSource

DOMAIN = 143


def test_missing_nodes_are_one_error_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    exchange = MessageExchange(DOMAIN, (topics.CLOCK,), (topics.WHEEL_COMMAND,), EventLog(lambda _: None))
    with pytest.raises(RpojaxError, match=r"^wait_s: found nobody within 0\.01 s, expected a publisher on /servicer/w"):
        exchange.wait_for_nodes(0.01)
    exchange.wait_for_nodes(0.0)


def test_a_domain_out_of_range_is_refused() -> None:
    with pytest.raises(RpojaxError, match=r"^domain_id: found 300, expected 0 to 232$"):
        Participant(300)


def test_valid_commands_arrive_among_invalid_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both sides in this process: a node that answers, and two that send invalid commands."""
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    events = EventLog(lambda _: None)
    exchange = MessageExchange(DOMAIN, (topics.CLOCK,), (topics.WHEEL_COMMAND,), events)
    node = Participant(DOMAIN)
    clock, wheels = node.subscriber(topics.CLOCK), node.publisher(topics.WHEEL_COMMAND)
    hostile = node.publisher(topics.WHEEL_COMMAND)
    other_type = Topic(
        topics.WHEEL_COMMAND.name,
        "geometry_msgs/msg/PointStamped",
        "",
        "",
        TopicSource.FLIGHT,
        TopicRate.TICK,
        "",
    )
    mismatched = Participant(DOMAIN).publisher(other_type)
    exchange.wait_for_nodes(30.0)
    lockstep, steps = LockstepClock(30.0), 20
    for step in range(steps):
        time_ns = step * NANO
        exchange.publish([(topics.CLOCK, partial(message_builders.clock_message, time_ns))])
        exchange.count_type_mismatches()
        assert clock.wait(30.0)
        assert [message.clock.sec for message in clock.take_messages()] == [step]
        mismatched.send(message_builders.gps(time_ns, np.zeros(3)))
        for stamp_ns, size in ((time_ns, np.nan), (time_ns, 1000.0), (time_ns - NANO, 0.01), (time_ns + NANO, 0.01)):
            hostile.send(torque_command(stamp_ns, size))
        wheels.send(torque_command(time_ns, 1e-3 * step))
        subscription = exchange.subscriptions[topics.WHEEL_COMMAND.name]
        assert lockstep.wait_for_command(subscription, time_ns, torque_size) == 1e-3 * step
    assert rejections(events) == {
        "not finite": steps,
        "beyond limit": steps,
        "stale stamp": steps,
        "stamp ahead": steps,
        "wrong type geometry_msgs::msg::dds_::PointStamped_": 1,
    }
    assert exchange.sent == {topics.CLOCK.name: steps}
    assert exchange.received == {topics.WHEEL_COMMAND.name: 5 * steps}
    assert exchange.unsent == 0
