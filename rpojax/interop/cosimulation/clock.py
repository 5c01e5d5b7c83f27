"""When a live run goes on: as soon as its commands are there, or when the wall clock says so."""

import time
from dataclasses import dataclass, field
from typing import Any, Protocol

from rpojax.interop.cosimulation.message_exchange import Check, Heard, T
from rpojax.interop.ros2.message_builders import NANO


class Pace(Protocol):
    """How long a command is waited for, and how long a step takes."""

    def command(self, heard: Heard, at: int, check: Check[T]) -> T | None:
        """The command for the time `at` [ns], None if it is late."""
        ...

    def hold(self, end: int) -> None:
        """Waits until the step that ends at a time [ns] may end."""
        ...


@dataclass
class Lockstep:
    """Every command carries the very stamp that it answers, and the run waits for it.

    Attributes:
        timeout_s: but no longer
    """

    timeout_s: float

    def command(self, heard: Heard, at: int, check: Check[T]) -> T | None:
        """The command with this stamp."""
        found = heard.command(at, True, check, time.monotonic() + self.timeout_s)
        return None if found is None else found[1]

    def hold(self, end: int) -> None:
        """Goes on at once."""


@dataclass
class RealTime:
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
    _last: dict[str, tuple[int, Any]] = field(default_factory=dict)

    def command(self, heard: Heard, at: int, check: Check[T]) -> T | None:
        """The newest command that has come until the end of the step that begins at `at` [ns]."""
        found = heard.command(at, False, check, self._wall(at + self.step_ns))
        if found is not None:
            self._last[heard.topic.name] = found
        stamp, content = self._last.get(heard.topic.name, (None, None))
        if stamp is None or at - stamp > self.timeout_s * self.factor * NANO:
            return None
        return content

    def hold(self, end: int) -> None:
        """Sleeps until it is time."""
        left = self._wall(end) - time.monotonic()
        self.lag_s = max(self.lag_s, -left)
        if left > 0.0:
            time.sleep(left)

    def _wall(self, at: int) -> float:
        return self.started + at / NANO / self.factor
