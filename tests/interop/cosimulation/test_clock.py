"""Clocks of live runs: commands by stamp in lockstep, by age in real time, waiting never longer than the timeout."""

import time
from typing import Any

import numpy as np
from command_inbox import INSTANT_S, Inbox, Sample, rejections, torque_command, torque_size, wheel_subscription

from rpojax.interop.cosimulation.clock import LockstepClock, RealTimeClock
from rpojax.interop.cosimulation.command_subscription import CommandSubscription
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S as NANO


def test_lockstep_accepts_only_the_command_with_the_exact_stamp() -> None:
    first = [torque_command(3), None, torque_command(5), torque_command(4, np.nan), torque_command(4, 0.02)]
    subscription, events = wheel_subscription([*first, torque_command(4, 0.01)])
    assert LockstepClock(1.0).wait_for_command(subscription, 4, torque_size) == 0.02
    assert rejections(events) == {"stale stamp": 1, "unreadable": 1, "stamp ahead": 1, "not finite": 1}
    # The second command with that stamp is examined with the next request.
    assert LockstepClock(INSTANT_S).wait_for_command(subscription, 6, torque_size) is None
    assert rejections(events)["stale stamp"] == 2
    assert subscription.received == 6


def test_a_flood_of_stale_commands_does_not_extend_the_timeout() -> None:
    class Flood(Inbox):
        def take_samples(self) -> list[Sample]:
            return [Sample(torque_command(1))] * 64

    events = EventLog(lambda _: None)
    inbox: Any = Flood()
    begin = time.monotonic()
    subscription = CommandSubscription(topics.WHEEL_COMMAND, inbox, events)
    assert LockstepClock(0.05).wait_for_command(subscription, 4, torque_size) is None
    assert time.monotonic() - begin < 5.0
    assert rejections(events)["stale stamp"] > 0


def test_real_time_uses_the_newest_command_until_its_largest_age() -> None:
    first = [torque_command(2 * NANO, 0.01), torque_command(4 * NANO, 0.02), torque_command(3 * NANO, 0.03)]
    subscription, events = wheel_subscription(first, [torque_command(9 * NANO)])
    clock = RealTimeClock(factor=1.0, step_ns=NANO // 5, timeout_s=2.0, started=time.monotonic() - 100.0)
    assert clock.wait_for_command(subscription, 5 * NANO, torque_size) == 0.02
    assert clock.wait_for_command(subscription, 6 * NANO, torque_size) == 0.02
    assert clock.wait_for_command(subscription, 7 * NANO, torque_size) is None
    assert rejections(events) == {"stale stamp": 1, "stamp ahead": 1}


def test_real_time_sleeps_until_the_end_of_a_step_and_records_its_lag() -> None:
    clock = RealTimeClock(factor=10.0, step_ns=NANO // 5, timeout_s=1.0)
    clock.wait_until(NANO // 2)
    assert time.monotonic() - clock.started >= 0.05
    clock.started -= 1.0
    clock.wait_until(NANO // 2)
    assert clock.lag_s >= 0.9
