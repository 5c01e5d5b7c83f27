"""What the other side has decided, and what is done instead where it has not."""

import time
from typing import Any

import jax.numpy as jnp
import numpy as np

from rpojax.errors import UnfinishedError
from rpojax.interop.cosimulation import command_checks, live_topics
from rpojax.interop.cosimulation.clock import Pace
from rpojax.interop.cosimulation.command_checks import Limits, Window
from rpojax.interop.cosimulation.event_log import Ledger
from rpojax.interop.cosimulation.live_settings import Settings
from rpojax.interop.cosimulation.message_exchange import Check, Exchange, T
from rpojax.interop.cosimulation.odometry_input import given_orbit
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.frame_names import from_orientation
from rpojax.interop.ros2.message_builders import NANO, Said
from rpojax.interop.ros2.topics import Topic
from rpojax.simulation.external_stages import Decider, GivenBurn, GivenOrbit

CLOSED = GivenBurn(ignition=jnp.zeros(()), cutoff=jnp.zeros(()), q_burn=jnp.array([1.0, 0.0, 0.0, 0.0]))
"""No burn."""


class Orders:
    """The other side of a run: commands as they are asked for, each for its time [ns].

    Each raises `UnfinishedError` where the run is to stop: on a late command if so agreed, and after a long silence.
    """

    def __init__(self, settings: Settings, limits: Limits, exchange: Exchange, pace: Pace, ledger: Ledger) -> None:
        self._settings, self._limits = settings, limits
        self._exchange, self._pace, self._ledger = exchange, pace, ledger
        self._torque = np.zeros(3)
        self._window = Window()
        self._answered = time.monotonic()

    def say(self, said: Said) -> None:
        """Sends messages."""
        self._exchange.say(said)

    def hold(self, end: int) -> None:
        """Waits until a step that ends at a time [ns] may end."""
        self._pace.hold(end)

    def torque(self, at: int) -> np.ndarray:
        """Wheel torques (3,) [N m] of a plant step."""
        found = self._command(
            topics.WHEEL_COMMAND, at, lambda message: command_checks.wheel_torque(message, self._limits)
        )
        if found is None:
            kept = self._late(topics.WHEEL_COMMAND, at, "the last torques hold", "no torque")
            return self._torque if kept else np.zeros(3)
        if (np.abs(found) > self._limits.torque * (1.0 + 1e-9)).any():
            self._ledger.limit(topics.WHEEL_COMMAND)
        self._torque = found
        return found

    def burn(self, at: int) -> tuple[Decider, GivenBurn]:
        """Who has decided on the burn of a tick, and what."""

        def check(message: Any) -> Window | command_checks.Reason:
            return command_checks.burn_window(message, self._limits, at, self._window)

        found = self._command(topics.THRUSTER_COMMAND, at, check)
        if found is None:
            kept = self._late(topics.THRUSTER_COMMAND, at, "the plan holds", "no burn")
            return ("nobody", CLOSED) if kept else self._closed(at)
        if found == Window():
            return self._closed(at)
        xyzw = self._command(live_topics.ATTITUDE_TARGET, at, command_checks.orientation)
        if xyzw is None:
            kept = self._late(live_topics.ATTITUDE_TARGET, at, "the plan holds", "no burn")
            return ("nobody", CLOSED) if kept else self._closed(at)
        if found == self._window:
            return "nobody", CLOSED
        self._window = found
        return "given", GivenBurn(
            ignition=jnp.asarray(found.ignition / NANO, dtype=jnp.float64),
            cutoff=jnp.asarray(found.cutoff / NANO, dtype=jnp.float64),
            q_burn=from_orientation(jnp.asarray(xyzw)),
        )

    def estimate(self, at: int) -> GivenOrbit | None:
        """Orbit estimate of a tick; None where the own filter has to go on from the last one."""
        servicer = self._command(topics.SERVICER_ESTIMATE, at, command_checks.servicer_odometry)
        relative = self._command(topics.RELATIVE_ESTIMATE, at, command_checks.relative_odometry)
        for topic, found in ((topics.SERVICER_ESTIMATE, servicer), (topics.RELATIVE_ESTIMATE, relative)):
            if found is None:
                self._late(topic, at, "the own filter goes on", "the own filter goes on")
        return None if servicer is None or relative is None else given_orbit(servicer, relative)

    def _closed(self, at: int) -> tuple[Decider, GivenBurn]:
        """The valve closed, where it is open or about to be."""
        pending, self._window = self._window.cutoff > at, Window()
        return ("given" if pending else "nobody"), CLOSED

    def _command(self, topic: Topic, at: int, check: Check[T]) -> T | None:
        found = self._pace.command(self._exchange.heard[topic.name], at, check)
        if found is not None:
            self._answered = time.monotonic()
        return found

    def _late(self, topic: Topic, at: int, held: str, zero: str) -> bool:
        """Counts a late command; tells whether the last one holds."""
        hold = self._settings.on_late == "hold"
        self._ledger.miss(topic, at / NANO, held if hold else zero)
        if self._settings.on_late == "stop":
            raise UnfinishedError(f"{topic.name}: found no command for {at / NANO:g} s in time, expected one")
        if time.monotonic() - self._answered > self._settings.patience_s:
            raise UnfinishedError(
                f"{topic.name}: found no command at all for {self._settings.patience_s:g} s, expected one"
            )
        return hold
