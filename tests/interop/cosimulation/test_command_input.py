"""Commands of external nodes and the fallback for late ones."""

from typing import Any

import numpy as np
import pytest
from command_inbox import INSTANT_S, LIMITS, InboxExchange, attitude_target, torque_command

from rpojax.errors import UnfinishedError
from rpojax.interop.cosimulation import live_topics
from rpojax.interop.cosimulation.clock import LockstepClock
from rpojax.interop.cosimulation.command_input import CommandInput
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.cosimulation.live_settings import ExternalStage, LatePolicy, LiveSettings
from rpojax.interop.ros2 import message_builders, topics
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S as NANO


def command_input(
    on_late: LatePolicy = "hold", patience_s: float = 100.0, **batches: list[Any]
) -> tuple[CommandInput, EventLog]:
    """Command input in lockstep that receives given commands and waits for no others."""
    events = EventLog(lambda _: None)
    settings = LiveSettings(external_stages=frozenset(ExternalStage), on_late=on_late, patience_s=patience_s)
    exchange: Any = InboxExchange(events, **batches)
    return CommandInput(settings, LIMITS, exchange, LockstepClock(INSTANT_S), events), events


def burn(time_ns: int, ignition_s: int = 60, cutoff_s: int = 80) -> Any:
    return message_builders.thruster_command(time_ns, ignition_s * NANO, cutoff_s * NANO, 0.03)


def target(time_ns: int) -> Any:
    return attitude_target(time_ns, [0.6, 0.0, 0.0, 0.8])


def test_a_late_torque_is_held_or_zero() -> None:
    for on_late, size in (("hold", 0.02), ("zero", 0.0)):
        commands, events = command_input(on_late, wheels=[torque_command(0, 0.02)])
        assert commands.wheel_torque(0)[0] == 0.02
        assert commands.wheel_torque(NANO)[0] == size
        assert events.late == {topics.WHEEL_COMMAND.name: 1}


def test_a_torque_beyond_the_drive_limit_is_counted() -> None:
    commands, events = command_input(wheels=[torque_command(0, 0.05)])
    assert commands.wheel_torque(0)[0] == 0.05
    assert events.limited == {topics.WHEEL_COMMAND.name: 1}
    assert not events.ignored


def test_a_late_command_stops_the_run_under_the_stop_policy() -> None:
    commands, _ = command_input("stop")
    with pytest.raises(UnfinishedError, match=r"^/servicer/wheels/command: found no command for 3 s in time[^\n]*$"):
        commands.wheel_torque(3 * NANO)


def test_a_long_silence_stops_the_run() -> None:
    commands, _ = command_input("hold", patience_s=INSTANT_S)
    with pytest.raises(UnfinishedError, match=r"^/servicer/wheels/command: found no command at all for [^\n]*$"):
        commands.wheel_torque(0)


def test_a_repeated_burn_is_planned_once_with_its_attitude() -> None:
    commands, events = command_input(
        thruster=[burn(0), burn(NANO), burn(2 * NANO, 0, 0)], target=[target(0), target(NANO), target(2 * NANO)]
    )
    planned = commands.burn_command(0)
    assert planned.commanded
    np.testing.assert_array_equal([planned.ignition, planned.cutoff], [60.0, 80.0])
    np.testing.assert_array_equal(planned.q_burn, [0.8, -0.6, 0.0, 0.0])
    assert not commands.burn_command(NANO).commanded
    planned = commands.burn_command(2 * NANO)
    assert planned.commanded
    assert float(planned.cutoff) <= float(planned.ignition)
    assert not events.late
    assert not events.ignored


def test_a_burn_without_its_attitude_is_not_planned() -> None:
    commands, events = command_input(thruster=[burn(0)])
    assert not commands.burn_command(0).commanded
    assert events.late == {live_topics.ATTITUDE_TARGET.name: 1}


def test_a_late_thruster_command_keeps_or_cancels_the_burn() -> None:
    for on_late, commanded in (("hold", False), ("zero", True)):
        commands, _ = command_input(on_late, thruster=[burn(0)], target=[target(0)])
        assert commands.burn_command(0).commanded
        assert bool(commands.burn_command(NANO).commanded) is commanded
