"""Waiting for commands: by stamp in lockstep, by age in real time, and never for longer than agreed."""

import time
from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest

from rpojax.errors import RpojaxError, UnfinishedError
from rpojax.interop.cosimulation import command_checks, live_topics
from rpojax.interop.cosimulation.clock import LockstepClock, RealTimeClock
from rpojax.interop.cosimulation.command_checks import CommandLimits, RejectionReason
from rpojax.interop.cosimulation.command_input import CommandInput
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.cosimulation.live_settings import ExternalStage, LatePolicy, LiveSettings, parse_external_stages
from rpojax.interop.cosimulation.message_exchange import CommandSubscription, MessageExchange
from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.dds_participant import Participant
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S

LIMITS = CommandLimits(torque=np.full(3, 0.025), minimum_on_time_s=0.5, maximum_on_time_s=110.0)
DOMAIN = 143
NOTHING = 1e-9


@dataclass
class Sample:
    """As it comes out of DDS; what cannot be read has no message."""

    message: Any

    @property
    def stamp(self) -> int | None:
        return None if self.message is None else command_checks.header_stamp_ns(self.message)


class Inbox:
    """A subscriber whose messages are put in by a test."""

    def __init__(self, *batches: list[Any]) -> None:
        self.batches = list(batches)
        self.waited = 0

    publisher_count = 1

    def take_samples(self) -> list[Sample]:
        return list(map(Sample, self.batches.pop(0))) if self.batches else []

    def wait(self, seconds: float) -> bool:
        self.waited += 1
        return bool(self.batches)


def torque(at: int, size: float = 0.01) -> Any:
    return message_builders.wheel_command(at, np.array([size, 0.0, 0.0]))


def heard(*batches: list[Any]) -> tuple[CommandSubscription, EventLog, list[str]]:
    lines: list[str] = []
    ledger = EventLog(lines.append)
    inbox: Any = Inbox(*batches)
    return CommandSubscription(topics.WHEEL_COMMAND, inbox, ledger), ledger, lines


def check(message: Any) -> float | RejectionReason:
    """Size of a torque command."""
    found = command_checks.wheel_torque(message, LIMITS)
    return found if isinstance(found, RejectionReason) else float(found[0])


def reasons(ledger: EventLog) -> Counter[str]:
    return Counter({reason: count for (_, reason), count in ledger.ignored.items()})


def test_in_lockstep_only_the_command_with_the_stamp_counts() -> None:
    box, ledger, _ = heard([torque(3), None, torque(5), torque(4, np.nan), torque(4, 0.02), torque(4, 0.01)])
    assert LockstepClock(1.0).wait_for_command(box, 4, check) == 0.02
    assert reasons(ledger) == {"stale stamp": 1, "unreadable": 1, "stamp ahead": 1, "not finite": 1}
    # Who answers twice is told so when the next command is asked for.
    assert LockstepClock(NOTHING).wait_for_command(box, 6, check) is None
    assert reasons(ledger)["stale stamp"] == 2
    assert box.received == 6


def test_a_flood_is_not_listened_to_for_longer_than_agreed() -> None:
    class Flood(Inbox):
        def take_samples(self) -> list[Sample]:
            return [Sample(torque(1))] * 64

    ledger = EventLog(lambda _: None)
    inbox: Any = Flood()
    begin = time.monotonic()
    assert (
        LockstepClock(0.05).wait_for_command(CommandSubscription(topics.WHEEL_COMMAND, inbox, ledger), 4, check) is None
    )
    assert time.monotonic() - begin < 5.0
    assert reasons(ledger)["stale stamp"] > 0


def test_in_real_time_the_newest_command_counts_until_it_is_old() -> None:
    box, ledger, _ = heard(
        [torque(2 * NANOSECONDS_PER_S, 0.01), torque(4 * NANOSECONDS_PER_S, 0.02), torque(3 * NANOSECONDS_PER_S, 0.03)],
        [torque(9 * NANOSECONDS_PER_S)],
    )
    pace = RealTimeClock(factor=1.0, step_ns=NANOSECONDS_PER_S // 5, timeout_s=2.0, started=time.monotonic() - 100.0)
    assert pace.wait_for_command(box, 5 * NANOSECONDS_PER_S, check) == 0.02
    assert pace.wait_for_command(box, 6 * NANOSECONDS_PER_S, check) == 0.02
    assert pace.wait_for_command(box, 7 * NANOSECONDS_PER_S, check) is None
    assert reasons(ledger) == {"stale stamp": 1, "stamp ahead": 1}


def test_real_time_holds_a_step_until_its_end() -> None:
    pace = RealTimeClock(factor=10.0, step_ns=NANOSECONDS_PER_S // 5, timeout_s=1.0)
    pace.wait_until(NANOSECONDS_PER_S // 2)
    assert time.monotonic() - pace.started >= 0.05
    pace.started -= 1.0
    pace.wait_until(NANOSECONDS_PER_S // 2)
    assert pace.lag_s >= 0.9


def test_a_reader_is_not_flooded_by_what_is_ignored() -> None:
    _, ledger, lines = heard()
    for _ in range(250):
        ledger.count_ignored(topics.WHEEL_COMMAND, RejectionReason.STALE)
    name = topics.WHEEL_COMMAND.name
    told = f"{name}: ignored, stale stamp"
    assert lines == [told, f"{told} (10 times)", f"{told} (100 times)"]
    assert ledger.ignored == {(name, "stale stamp"): 250}


class Office:
    """An exchange whose inboxes are filled by a test."""

    def __init__(self, ledger: EventLog, **boxes: list[Any]) -> None:
        names = {"wheels": topics.WHEEL_COMMAND, "thruster": topics.THRUSTER_COMMAND}
        names |= {"target": live_topics.ATTITUDE_TARGET}
        self.subscriptions = {}
        for key, topic in names.items():
            inbox: Any = Inbox(boxes.get(key, []))
            self.subscriptions[topic.name] = CommandSubscription(topic, inbox, ledger)


def orders(
    on_late: LatePolicy = "hold", patience_s: float = 100.0, **boxes: list[Any]
) -> tuple[CommandInput, EventLog]:
    ledger = EventLog(lambda _: None)
    settings = LiveSettings(external_stages=frozenset(ExternalStage), on_late=on_late, patience_s=patience_s)
    office: Any = Office(ledger, **boxes)
    return CommandInput(settings, LIMITS, office, LockstepClock(NOTHING), ledger), ledger


def test_a_late_torque_holds_or_is_none_as_agreed() -> None:
    for on_late, size in (("hold", 0.02), ("zero", 0.0)):
        found, ledger = orders(on_late, wheels=[torque(0, 0.02)])
        assert found.wheel_torque(0)[0] == 0.02
        assert found.wheel_torque(NANOSECONDS_PER_S)[0] == size
        assert ledger.late == {topics.WHEEL_COMMAND.name: 1}


def test_a_torque_that_the_drive_cannot_give_is_counted() -> None:
    found, ledger = orders(wheels=[torque(0, 0.05)])
    assert found.wheel_torque(0)[0] == 0.05
    assert ledger.limited == {topics.WHEEL_COMMAND.name: 1}
    assert not ledger.ignored


def test_a_late_command_stops_the_run_if_so_agreed() -> None:
    found, _ = orders("stop")
    with pytest.raises(UnfinishedError, match=r"^/servicer/wheels/command: found no command for 3 s in time[^\n]*$"):
        found.wheel_torque(3 * NANOSECONDS_PER_S)


def test_a_long_silence_stops_the_run() -> None:
    found, _ = orders("hold", patience_s=NOTHING)
    with pytest.raises(UnfinishedError, match=r"^/servicer/wheels/command: found no command at all for [^\n]*$"):
        found.wheel_torque(0)


def burn(at: int, ignition_s: int = 60, cutoff_s: int = 80) -> Any:
    return message_builders.thruster_command(at, ignition_s * NANOSECONDS_PER_S, cutoff_s * NANOSECONDS_PER_S, 0.03)


def target(at: int) -> Any:
    return live_topics.attitude_target(at, np.array([0.6, 0.0, 0.0, 0.8]))


def test_a_burn_is_taken_over_once_with_its_attitude() -> None:
    found, ledger = orders(
        thruster=[burn(0), burn(NANOSECONDS_PER_S), burn(2 * NANOSECONDS_PER_S, 0, 0)],
        target=[target(0), target(NANOSECONDS_PER_S), target(2 * NANOSECONDS_PER_S)],
    )
    decider, given = found.burn_command(0)
    assert decider == "given"
    np.testing.assert_array_equal([given.ignition, given.cutoff], [60.0, 80.0])
    np.testing.assert_array_equal(given.q_burn, [0.8, -0.6, 0.0, 0.0])
    assert found.burn_command(NANOSECONDS_PER_S)[0] == "nobody"
    decider, given = found.burn_command(2 * NANOSECONDS_PER_S)
    assert decider == "given"
    assert float(given.cutoff) <= float(given.ignition)
    assert not ledger.late
    assert not ledger.ignored


def test_a_burn_without_its_attitude_is_none() -> None:
    found, ledger = orders(thruster=[burn(0)])
    assert found.burn_command(0)[0] == "nobody"
    assert ledger.late == {live_topics.ATTITUDE_TARGET.name: 1}


def test_a_silent_node_keeps_its_burn_or_loses_it_as_agreed() -> None:
    for on_late, decider in (("hold", "nobody"), ("zero", "given")):
        found, _ = orders(on_late, thruster=[burn(0)], target=[target(0)])
        assert found.burn_command(0)[0] == "given"
        assert found.burn_command(NANOSECONDS_PER_S)[0] == decider


@pytest.mark.parametrize(
    ("text", "stages"),
    [
        ("none", frozenset()),
        ("all", frozenset(ExternalStage)),
        ("attitude", frozenset({ExternalStage.ATTITUDE})),
        ("formation, attitude", frozenset({ExternalStage.ATTITUDE, ExternalStage.FORMATION})),
    ],
)
def test_stages_are_named_by_words(text: str, stages: frozenset[ExternalStage]) -> None:
    assert parse_external_stages(text) == stages


@pytest.mark.parametrize("text", ["", "guidance", "all,attitude"])
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(RpojaxError, match=r"^--external: found '[^\n]*', expected attitude, formation, navigation"):
        parse_external_stages(text)


@pytest.mark.parametrize(
    ("changes", "option"),
    [
        ({"timeout_s": 0.0}, "--timeout-s"),
        ({"timeout_s": float("nan")}, "--timeout-s"),
        ({"patience_s": -1.0}, "--patience-s"),
        ({"wait_s": float("inf")}, "--wait-s"),
        ({"real_time_factor": 0.0}, "--real-time"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, float], option: str) -> None:
    with pytest.raises(RpojaxError, match=rf"^{option}: found [^\n]*, expected [^\n]*$"):
        LiveSettings(**changes)


def test_what_is_left_to_others_is_not_said() -> None:
    settings = LiveSettings(external_stages=frozenset({ExternalStage.ATTITUDE}))
    assert settings.command_topics == (topics.WHEEL_COMMAND,)
    assert topics.WHEEL_COMMAND not in settings.published_topics
    assert {topics.CLOCK, topics.THRUSTER_COMMAND, live_topics.ATTITUDE_REFERENCE} <= set(settings.published_topics)


def test_nobody_there_is_one_error_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    exchange = MessageExchange(DOMAIN, (topics.CLOCK,), (topics.WHEEL_COMMAND,), EventLog(lambda _: None))
    with pytest.raises(
        RpojaxError, match=r"^--wait-s: found nobody within 0\.01 s, expected a publisher on /servicer/w"
    ):
        exchange.wait_for_nodes(0.01)
    exchange.wait_for_nodes(0.0)


def test_a_domain_out_of_range_is_refused() -> None:
    with pytest.raises(RpojaxError, match=r"^--domain-id: found 300, expected 0 to 232$"):
        Participant(300)


def test_commands_and_nonsense_over_the_wire(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loopback, both sides in this process: a node that answers, and one that is hostile."""
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    ledger = EventLog(lambda _: None)
    exchange = MessageExchange(DOMAIN, (topics.CLOCK,), (topics.WHEEL_COMMAND,), ledger)
    node = Participant(DOMAIN)
    clock, wheels = node.subscriber(topics.CLOCK), node.publisher(topics.WHEEL_COMMAND)
    hostile = node.publisher(topics.WHEEL_COMMAND)
    other_type = topics.Topic(topics.WHEEL_COMMAND.name, "geometry_msgs/msg/PointStamped", "", "", *("",) * 3)
    stranger = Participant(DOMAIN).publisher(other_type)
    exchange.wait_for_nodes(30.0)
    pace, steps = LockstepClock(30.0), 20
    for step in range(steps):
        at = step * NANOSECONDS_PER_S
        exchange.publish([(topics.CLOCK, partial(message_builders.clock_message, at))])
        exchange.count_type_mismatches()
        assert clock.wait(30.0)
        assert [message.clock.sec for message in clock.take_messages()] == [step]
        stranger.send(message_builders.gps(at, np.zeros(3)))
        for nonsense in (
            torque(at, np.nan),
            torque(at, 1000.0),
            torque(at - NANOSECONDS_PER_S),
            torque(at + NANOSECONDS_PER_S),
        ):
            hostile.send(nonsense)
        wheels.send(torque(at, 1e-3 * step))
        assert pace.wait_for_command(exchange.subscriptions[topics.WHEEL_COMMAND.name], at, check) == 1e-3 * step
    assert reasons(ledger) == {
        "not finite": steps,
        "beyond limit": steps,
        "stale stamp": steps,
        "stamp ahead": steps,
        "wrong type geometry_msgs::msg::dds_::PointStamped_": 1,
    }
    assert exchange.sent == {topics.CLOCK.name: steps}
    assert exchange.received == {topics.WHEEL_COMMAND.name: 5 * steps}
    assert exchange.unsent == 0
