"""Settings of a live run: external stages, timeouts and the policy for late commands. Free of jax and numpy."""

import enum
from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import Fixed, arg
from tyro.constructors import PrimitiveConstructorSpec

from rpojax.errors import RpojaxError

LatePolicy = Literal["hold", "zero", "stop"]
"""Replacement of a late command: the last one, none, or the run stops."""
_LONGEST_S = 1e6
_LARGEST_FACTOR = 1e4


class ExternalStage(enum.StrEnum):
    """Part of the flight software that external nodes can replace."""

    ATTITUDE = "attitude"
    FORMATION = "formation"
    NAVIGATION = "navigation"


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
            raise RpojaxError.of_argument(
                "external_stages", f"found {word!r}, expected {', '.join(ExternalStage)}, all or none"
            )
    return frozenset(ExternalStage(word) for word in names)


ExternalStages = Annotated[
    frozenset[ExternalStage],
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="A,B,...",
        instance_from_str=lambda words: parse_external_stages(words[0]),
        is_instance=lambda value: isinstance(value, frozenset),
        str_from_instance=lambda stages: [",".join(sorted(stages)) or "none"],
    ),
]
"""Stages, on the command line as `parse_external_stages` takes them."""


@dataclass(frozen=True)
class LiveSettings:
    """Settings of a live run. All times are real time.

    The command `rpojax bridge` has the fields as options, except those marked `Fixed`.

    Attributes:
        external_stages: stages left to external nodes
        domain_id: DDS domain
        on_late: replacement of a late command
        timeout_s: time after which a command is late
        wait_s: time to wait for external nodes at the start; 0 to start at once
        patience_s: time without any command after which the run ends
        real_time_factor: simulated over real time; None for lockstep
        send_images: whether images of a rendered camera are sent

    Raises:
        RpojaxError: a time or the factor is out of range.
    """

    external_stages: Annotated[
        ExternalStages,
        arg(
            name="external",
            help="Flight software left to external nodes: attitude, formation, navigation, all.",
        ),
    ] = frozenset()
    domain_id: Annotated[int, arg(metavar="N", help="DDS domain, as ROS_DOMAIN_ID.")] = 0
    on_late: Annotated[LatePolicy, arg(help="On a late command: hold the last one, use zero, or stop the run.")] = (
        "hold"
    )
    timeout_s: Annotated[float, arg(metavar="T", help="Wall-clock time after which a command is late [s].")] = 1.0
    wait_s: Annotated[
        float, arg(metavar="T", help="Time to wait for external nodes at the start [s]; 0 to start at once.")
    ] = 30.0
    patience_s: Annotated[float, arg(metavar="T", help="Time without any command after which the run ends [s].")] = 30.0
    real_time_factor: Annotated[
        float | None,
        arg(
            name="real-time",
            metavar="FACTOR",
            help="Follow the wall clock at this multiple of real time.",
            help_behavior_hint="(default: in lockstep, as fast as the answers come)",
        ),
    ] = None
    send_images: Fixed[bool] = True

    def __post_init__(self) -> None:
        for name, value in (("timeout_s", self.timeout_s), ("patience_s", self.patience_s)):
            if not 0.0 < value < _LONGEST_S:
                raise RpojaxError.of_argument(
                    name, f"found {value:g}, expected more than 0 and less than {_LONGEST_S:g}"
                )
        if not 0.0 <= self.wait_s < _LONGEST_S:
            raise RpojaxError.of_argument(
                "wait_s", f"found {self.wait_s:g}, expected 0 or more and less than {_LONGEST_S:g}"
            )
        if self.real_time_factor is not None and not 0.0 < self.real_time_factor <= _LARGEST_FACTOR:
            raise RpojaxError.of_argument(
                "real_time_factor",
                f"found {self.real_time_factor:g}, expected more than 0 and at most {_LARGEST_FACTOR:g}",
            )
