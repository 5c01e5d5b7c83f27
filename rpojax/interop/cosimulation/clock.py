"""When a live run goes on: as soon as its commands are there, or when the wall clock says so."""

import time
from dataclasses import dataclass, field
from typing import Any, Protocol

from rpojax.interop.cosimulation.message_exchange import CommandCheck, CommandSubscription, T
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S


class Clock(Protocol):
    """How long a command is waited for, and how long a step takes."""

    def wait_for_command(self, subscription: CommandSubscription, time_ns: int, check: CommandCheck[T]) -> T | None:
        """The command for the time `at` [ns], None if it is late."""
        ...

    def wait_until(self, time_ns: int) -> None:
        """Waits until the step that ends at a time [ns] may end."""
        ...


@dataclass
class LockstepClock:
    """Every command carries the very stamp that it answers, and the run waits for it.

    Attributes:
        timeout_s: but no longer
    """

    timeout_s: float

    def wait_for_command(self, subscription: CommandSubscription, time_ns: int, check: CommandCheck[T]) -> T | None:
        """The command with this stamp."""
        found = subscription.wait_for_command(time_ns, True, check, time.monotonic() + self.timeout_s)
        return None if found is None else found[1]

    def wait_until(self, time_ns: int) -> None:
        """Goes on at once."""


@dataclass
class RealTimeClock:
    """Steps begin and end by the wall clock; a command counts from its coming until a newer one, or until it is old.

    Attributes:
        factor: simulated over real time
        step_ns: of the plant [ns]
        timeout_s: age at which a command is old, in real time
        started: monotonic time of the start [s]
        lag_s: by how much the run was behind at worst, in real time
    """

    factor: float
    step_ns: int
    timeout_s: float
    started: float = field(default_factory=time.monotonic)
    lag_s: float = 0.0
    _latest: dict[str, tuple[int, Any]] = field(default_factory=dict)

    def wait_for_command(self, subscription: CommandSubscription, time_ns: int, check: CommandCheck[T]) -> T | None:
        """The newest command that has come until the end of the step that begins at `at` [ns]."""
        found = subscription.wait_for_command(time_ns, False, check, self._wall_time(time_ns + self.step_ns))
        if found is not None:
            self._latest[subscription.topic.name] = found
        stamp, content = self._latest.get(subscription.topic.name, (None, None))
        if stamp is None or time_ns - stamp > self.timeout_s * self.factor * NANOSECONDS_PER_S:
            return None
        return content

    def wait_until(self, time_ns: int) -> None:
        """Sleeps until it is time."""
        remaining_s = self._wall_time(time_ns) - time.monotonic()
        self.lag_s = max(self.lag_s, -remaining_s)
        if remaining_s > 0.0:
            time.sleep(remaining_s)

    def _wall_time(self, time_ns: int) -> float:
        return self.started + time_ns / NANOSECONDS_PER_S / self.factor
