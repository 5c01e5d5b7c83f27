"""Commands of external nodes as the flight software uses them, and the fallback for late ones."""

import time
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from rpojax.errors import UnfinishedError
from rpojax.interop.cosimulation import command_checks, live_topics
from rpojax.interop.cosimulation.clock import Clock
from rpojax.interop.cosimulation.command_checks import BurnWindow, CommandLimits
from rpojax.interop.cosimulation.command_subscription import CommandCheck, T
from rpojax.interop.cosimulation.event_log import EventLog
from rpojax.interop.cosimulation.live_settings import LiveSettings
from rpojax.interop.cosimulation.message_exchange import MessageExchange
from rpojax.interop.cosimulation.odometry_input import orbit_estimate_from_odometry
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S
from rpojax.interop.ros2.ros_orientation import quaternion_from_orientation
from rpojax.interop.ros2.tick_messages import TopicMessages
from rpojax.interop.ros2.topics import Topic
from rpojax.simulation.external_inputs import ExternalBurn, ExternalOrbitEstimate

NO_COMMAND = ExternalBurn(
    commanded=jnp.array(False), ignition=jnp.zeros(()), cutoff=jnp.zeros(()), q_burn=jnp.array([1.0, 0.0, 0.0, 0.0])
)
"""No command on burns: the plan stays."""
CLOSED_VALVE = replace(NO_COMMAND, commanded=jnp.array(True))
"""Command that closes the valve."""


class CommandInput:
    """Commands from external nodes, each for a simulation time [ns], with the chosen fallback for late ones.

    All commands raise `UnfinishedError` on a late command where the policy is `stop`, and after a long silence.
    """

    def __init__(
        self, settings: LiveSettings, limits: CommandLimits, exchange: MessageExchange, clock: Clock, events: EventLog
    ) -> None:
        self._settings, self._limits = settings, limits
        self._exchange, self._clock, self._events = exchange, clock, events
        self._torque = np.zeros(3)
        self._burn_window = BurnWindow()
        self._last_command_at = time.monotonic()

    def publish(self, messages: TopicMessages) -> None:
        """Sends messages."""
        self._exchange.publish(messages)

    def wait_until(self, time_ns: int) -> None:
        """Waits until the step that ends at `time_ns` may end."""
        self._clock.wait_until(time_ns)

    def wheel_torque(self, time_ns: int) -> np.ndarray:
        """Wheel torques (3,) [N m] of a plant step."""
        found = self._wait_for_command(
            topics.WHEEL_COMMAND, time_ns, lambda message: command_checks.wheel_torque(message, self._limits)
        )
        if found is None:
            kept = self._count_late(topics.WHEEL_COMMAND, time_ns, "the last torques hold", "no torque")
            return self._torque if kept else np.zeros(3)
        if (np.abs(found) > self._limits.torque * (1.0 + 1e-9)).any():
            self._events.count_limited(topics.WHEEL_COMMAND)
        self._torque = found
        return found

    def burn_command(self, time_ns: int) -> ExternalBurn:
        """Burn command of a tick."""

        def check(message: Any) -> BurnWindow | command_checks.RejectionReason:
            return command_checks.burn_window(message, self._limits, time_ns, self._burn_window)

        found = self._wait_for_command(topics.THRUSTER_COMMAND, time_ns, check)
        if found is None:
            kept = self._count_late(topics.THRUSTER_COMMAND, time_ns, "the plan holds", "no burn")
            return NO_COMMAND if kept else self._close_valve(time_ns)
        if found == BurnWindow():
            return self._close_valve(time_ns)
        xyzw = self._wait_for_command(live_topics.ATTITUDE_TARGET, time_ns, command_checks.unit_orientation)
        if xyzw is None:
            kept = self._count_late(live_topics.ATTITUDE_TARGET, time_ns, "the plan holds", "no burn")
            return NO_COMMAND if kept else self._close_valve(time_ns)
        if found == self._burn_window:
            return NO_COMMAND
        self._burn_window = found
        return ExternalBurn(
            commanded=jnp.array(True),
            ignition=jnp.asarray(found.ignition_ns / NANOSECONDS_PER_S, dtype=jnp.float64),
            cutoff=jnp.asarray(found.cutoff_ns / NANOSECONDS_PER_S, dtype=jnp.float64),
            q_burn=quaternion_from_orientation(jnp.asarray(xyzw)),
        )

    def orbit_estimate(self, time_ns: int) -> ExternalOrbitEstimate | None:
        """Orbit estimate of a tick; None where the simulator's filter has to continue from the last one."""
        servicer = self._wait_for_command(topics.SERVICER_ESTIMATE, time_ns, command_checks.servicer_odometry)
        relative = self._wait_for_command(topics.RELATIVE_ESTIMATE, time_ns, command_checks.relative_odometry)
        for topic, found in ((topics.SERVICER_ESTIMATE, servicer), (topics.RELATIVE_ESTIMATE, relative)):
            if found is None:
                self._count_late(topic, time_ns, "the simulator's filter continues", "the simulator's filter continues")
        return None if servicer is None or relative is None else orbit_estimate_from_odometry(servicer, relative)

    def _close_valve(self, time_ns: int) -> ExternalBurn:
        """Burn command that closes the valve where it is open or will open, else leaves the plan."""
        pending, self._burn_window = self._burn_window.cutoff_ns > time_ns, BurnWindow()
        return CLOSED_VALVE if pending else NO_COMMAND

    def _wait_for_command(self, topic: Topic, time_ns: int, check: CommandCheck[T]) -> T | None:
        found = self._clock.wait_for_command(self._exchange.subscriptions[topic.name], time_ns, check)
        if found is not None:
            self._last_command_at = time.monotonic()
        return found

    def _count_late(self, topic: Topic, time_ns: int, hold_text: str, zero_text: str) -> bool:
        """Counts a late command and returns whether the last one holds."""
        hold = self._settings.on_late == "hold"
        self._events.count_late(topic, time_ns / NANOSECONDS_PER_S, hold_text if hold else zero_text)
        if self._settings.on_late == "stop":
            raise UnfinishedError(
                f"{topic.name}: found no command for {time_ns / NANOSECONDS_PER_S:g} s in time, expected one"
            )
        if time.monotonic() - self._last_command_at > self._settings.patience_s:
            raise UnfinishedError(
                f"{topic.name}: found no command at all for {self._settings.patience_s:g} s, expected one"
            )
        return hold
