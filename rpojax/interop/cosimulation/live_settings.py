"""What a live run leaves to the other side, and how it goes on when that is silent."""

import enum
from dataclasses import dataclass
from typing import Literal

from rpojax.errors import RpojaxError
from rpojax.interop.cosimulation import live_topics
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.topics import Topic


class Stage(enum.StrEnum):
    """A part of the flight software that somebody else can do."""

    ATTITUDE = "attitude"
    FORMATION = "formation"
    NAVIGATION = "navigation"


OnLate = Literal["hold", "zero", "stop"]
"""What becomes of a command that is late: the last one holds, there is none, or the run stops."""

COMMANDS: dict[Stage, tuple[Topic, ...]] = {
    Stage.ATTITUDE: (topics.WHEEL_COMMAND,),
    Stage.FORMATION: (topics.THRUSTER_COMMAND, live_topics.ATTITUDE_TARGET),
    Stage.NAVIGATION: (topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE),
}
"""Topics on which the other side speaks, by the stage that is left to it."""


@dataclass(frozen=True)
class Settings:
    """How a live run is flown.

    Attributes:
        external: stages that are left to the other side
        domain_id: of DDS
        on_late: what becomes of a late command
        timeout_s: after which a command is late, in real time
        wait_s: for the other side at the start, in real time; 0 to start at once
        patience_s: without any command the run ends, in real time
        factor: simulated over real time; None for lockstep
        pictures: of a rendered camera are sent
    """

    external: frozenset[Stage] = frozenset()
    domain_id: int = 0
    on_late: OnLate = "hold"
    timeout_s: float = 1.0
    wait_s: float = 30.0
    patience_s: float = 30.0
    factor: float | None = None
    pictures: bool = True

    def __post_init__(self) -> None:
        for name, value in (("--timeout-s", self.timeout_s), ("--patience-s", self.patience_s)):
            if not 0.0 < value < _FOR_EVER_S:
                raise RpojaxError(f"{name}: found {value:g}, expected more than 0 and less than {_FOR_EVER_S:g}")
        if not 0.0 <= self.wait_s < _FOR_EVER_S:
            raise RpojaxError(f"--wait-s: found {self.wait_s:g}, expected 0 or more and less than {_FOR_EVER_S:g}")
        if self.factor is not None and not 0.0 < self.factor <= _FASTEST:
            raise RpojaxError(f"--real-time: found {self.factor:g}, expected more than 0 and at most {_FASTEST:g}")

    @property
    def heard(self) -> tuple[Topic, ...]:
        """Topics that commands come on."""
        return tuple(topic for stage in Stage if stage in self.external for topic in COMMANDS[stage])

    @property
    def said(self) -> tuple[Topic, ...]:
        """Topics that this side may speak on."""
        own = (live_topics.ATTITUDE_ESTIMATE, live_topics.ATTITUDE_REFERENCE)
        taken = {topic.name for topic in self.heard}
        every = (*topics.TABLE, *(own if Stage.ATTITUDE in self.external else ()))
        return tuple(topic for topic in every if topic.name not in taken and topic is not topics.COMPRESSED_IMAGE)


_FOR_EVER_S = 1e6
_FASTEST = 1e4


def external(text: str) -> frozenset[Stage]:
    """Stages from words with commas between them; `all` and `none` are such words.

    Raises:
        RpojaxError: there is no such stage.
    """
    words = [word.strip() for word in text.split(",")]
    if words == ["none"]:
        return frozenset()
    if words == ["all"]:
        return frozenset(Stage)
    for word in words:
        if word not in set(Stage):
            raise RpojaxError(f"--external: found {word!r}, expected {', '.join(Stage)}, all or none")
    return frozenset(Stage(word) for word in words)
