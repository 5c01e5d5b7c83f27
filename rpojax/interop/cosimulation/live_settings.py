"""Settings of a live run: external stages, timeouts and the policy for late commands."""

import enum
from dataclasses import dataclass
from typing import Literal

from rpojax.errors import RpojaxError
from rpojax.interop.cosimulation import live_topics
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.topics import Topic


class ExternalStage(enum.StrEnum):
    """Part of the flight software that external nodes can replace."""

    ATTITUDE = "attitude"
    FORMATION = "formation"
    NAVIGATION = "navigation"


LatePolicy = Literal["hold", "zero", "stop"]
"""Replacement of a late command: the last one, none, or the run stops."""

COMMAND_TOPICS: dict[ExternalStage, tuple[Topic, ...]] = {
    ExternalStage.ATTITUDE: (topics.WHEEL_COMMAND,),
    ExternalStage.FORMATION: (topics.THRUSTER_COMMAND, live_topics.ATTITUDE_TARGET),
    ExternalStage.NAVIGATION: (topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE),
}
"""Topics that external nodes publish, by stage."""


@dataclass(frozen=True)
class LiveSettings:
    """Settings of a live run. All times are real time.

    Attributes:
        external_stages: stages left to external nodes
        domain_id: DDS domain
        on_late: replacement of a late command
        timeout_s: time after which a command is late
        wait_s: time to wait for external nodes at the start; 0 to start at once
        patience_s: time without any command after which the run ends
        real_time_factor: simulated over real time; None for lockstep
        send_images: whether images of a rendered camera are sent
    """

    external_stages: frozenset[ExternalStage] = frozenset()
    domain_id: int = 0
    on_late: LatePolicy = "hold"
    timeout_s: float = 1.0
    wait_s: float = 30.0
    patience_s: float = 30.0
    real_time_factor: float | None = None
    send_images: bool = True

    def __post_init__(self) -> None:
        for name, value in (("--timeout-s", self.timeout_s), ("--patience-s", self.patience_s)):
            if not 0.0 < value < _LONGEST_S:
                raise RpojaxError(f"{name}: found {value:g}, expected more than 0 and less than {_LONGEST_S:g}")
        if not 0.0 <= self.wait_s < _LONGEST_S:
            raise RpojaxError(f"--wait-s: found {self.wait_s:g}, expected 0 or more and less than {_LONGEST_S:g}")
        if self.real_time_factor is not None and not 0.0 < self.real_time_factor <= _LARGEST_FACTOR:
            raise RpojaxError(
                f"--real-time: found {self.real_time_factor:g}, expected more than 0 and at most {_LARGEST_FACTOR:g}"
            )

    @property
    def command_topics(self) -> tuple[Topic, ...]:
        """Topics of the commands that the simulator receives."""
        return tuple(
            topic for stage in ExternalStage if stage in self.external_stages for topic in COMMAND_TOPICS[stage]
        )

    @property
    def published_topics(self) -> tuple[Topic, ...]:
        """Topics that the simulator publishes."""
        attitude_topics = (live_topics.ATTITUDE_ESTIMATE, live_topics.ATTITUDE_REFERENCE)
        received = {topic.name for topic in self.command_topics}
        candidates = (*topics.ALL_TOPICS, *(attitude_topics if ExternalStage.ATTITUDE in self.external_stages else ()))
        return tuple(
            topic for topic in candidates if topic.name not in received and topic is not topics.COMPRESSED_IMAGE
        )


_LONGEST_S = 1e6
_LARGEST_FACTOR = 1e4


def parse_external_stages(text: str) -> frozenset[ExternalStage]:
    """Stages from a comma-separated list, `all` or `none`.

    Raises:
        RpojaxError: there is no such stage.
    """
    names = [word.strip() for word in text.split(",")]
    if names == ["none"]:
        return frozenset()
    if names == ["all"]:
        return frozenset(ExternalStage)
    for word in names:
        if word not in set(ExternalStage):
            raise RpojaxError(f"--external: found {word!r}, expected {', '.join(ExternalStage)}, all or none")
    return frozenset(ExternalStage(word) for word in names)
