"""Clocks of a live run: lockstep with the commands, or real time."""

import time
from dataclasses import dataclass, field
from typing import Any, Protocol

from rpojax.interop.cosimulation.command_subscription import CommandCheck, CommandSubscription, T
from rpojax.interop.ros2.message_builders import NANOSECONDS_PER_S


class Clock(Protocol):
    """Policy for how long to wait for commands and at the end of steps."""

    def wait_for_command(self, subscription: CommandSubscription, time_ns: int, check: CommandCheck[T]) -> T | None:
        """Command for simulation time `time_ns`, None if it is late."""
        ...

    def wait_until(self, time_ns: int) -> None:
        """Waits until the step that ends at simulation time `time_ns` may end."""
        ...


@dataclass
class LockstepClock:
    """Clock that waits for the command with exactly the stamp of the current step.

    Attributes:
        timeout_s: time after which a command is late, in real time
    """

    timeout_s: float

    def wait_for_command(self, subscription: CommandSubscription, time_ns: int, check: CommandCheck[T]) -> T | None:
        """Command with this stamp, None if it is late."""
        found = subscription.wait_for_command(time_ns, True, check, time.monotonic() + self.timeout_s)
        return None if found is None else found[1]

    def wait_until(self, time_ns: int) -> None:
        """Returns at once."""


@dataclass
class RealTimeClock:
    """Clock that follows the wall clock; a command is valid until a newer one arrives or its age is `timeout_s`.

    Attributes:
        factor: simulated over real time
        step_ns: plant step [ns]
        timeout_s: largest age of a command, in real time
        started: monotonic time of the start [s]
        lag_s: largest delay of the run behind the wall clock, in real time
    """

    factor: float
    step_ns: int
    timeout_s: float
    started: float = field(default_factory=time.monotonic)
    lag_s: float = 0.0
    _latest: dict[str, tuple[int, Any]] = field(default_factory=dict)

    def wait_for_command(self, subscription: CommandSubscription, time_ns: int, check: CommandCheck[T]) -> T | None:
        """Newest command received before the end of the step that begins at `time_ns`, None if it is too old."""
        found = subscription.wait_for_command(time_ns, False, check, self._wall_time(time_ns + self.step_ns))
        if found is not None:
            self._latest[subscription.topic.name] = found
        stamp, content = self._latest.get(subscription.topic.name, (None, None))
        if stamp is None or time_ns - stamp > self.timeout_s * self.factor * NANOSECONDS_PER_S:
            return None
        return content

    def wait_until(self, time_ns: int) -> None:
        """Sleeps until the wall clock has reached `time_ns`."""
        remaining_s = self._wall_time(time_ns) - time.monotonic()
        self.lag_s = max(self.lag_s, -remaining_s)
        if remaining_s > 0.0:
            time.sleep(remaining_s)

    def _wall_time(self, time_ns: int) -> float:
        return self.started + time_ns / NANOSECONDS_PER_S / self.factor
