"""Settings of a team of servicers, and what flight software believes of its members and of what lies between them."""

from dataclasses import dataclass
from typing import Literal

from jaxtyping import Array

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Sharing = Literal["none", "boxes", "estimates", "central", "naive"]


@dataclass(frozen=True)
class LinkSettings:
    """Static settings of messages between servicers.

    Attributes:
        servicers: their number
        sharing: what is shared, and how it is used
        period_ticks: camera ticks between two messages of a servicer
        delay_ticks: camera ticks from a message's time stamp to its reception
        hears: (receiver, sender) pairs with a link
        zonal_degree: highest zonal harmonic in the motion of baselines
        ranging: whether servicers measure their range to each other over the links
    """

    servicers: int
    sharing: Sharing
    period_ticks: int
    delay_ticks: int
    hears: tuple[tuple[int, int], ...]
    zonal_degree: int
    ranging: bool = False

    @property
    def peers(self) -> tuple[tuple[int, ...], ...]:
        """The other servicers of each, in the order of their states in its filter."""
        return tuple(tuple(j for j in range(self.servicers) if j != i) for i in range(self.servicers))

    @property
    def shares_boxes(self) -> bool:
        """Whether messages have boxes, and no estimates."""
        return self.sharing in ("boxes", "central")


@dataclass(frozen=True)
class TeamSettings:
    """Static settings of a team of servicers.

    Attributes:
        servicers: their number
        link: of the messages between them
        decision_offsets: camera ticks by which the burn decisions of each are later than at an offset of 0
        carrier_differences: whether differences of GPS positions are by carrier phase, not by code
        coordinated: whether the servicers tell each other their plans, and decide with these
    """

    servicers: int
    link: LinkSettings
    decision_offsets: tuple[int, ...]
    carrier_differences: bool
    coordinated: bool = False


@pytree
class BaselineTuning:
    """Belief of flight software in differences of two servicers' GPS positions, and in their range over the link."""

    noise: Array = number(
        "white noise per axis of the difference of two servicers' GPS positions in a team, 1 sigma; by default that "
        "by code in `inspection`",
        key="navigation.difference_noise_m",
        above=0.0,
        default=2.83,
    )
    error_sigma: Array = number(
        "its slowly varying error per axis, 1 sigma", key="navigation.difference_error_sigma_m", above=0.0, default=0.54
    )
    error_time_constant: Array = number(
        "its correlation time", key="navigation.difference_error_time_constant_s", above=0.0, default=700.0
    )
    range_noise: Array = number(
        "white noise of the range over the link between two servicers, 1 sigma",
        key="navigation.difference_range_noise_m",
        above=0.0,
        default=0.1,
    )
    range_bias_sigma: Array = number(
        "its constant bias, 1 sigma", key="navigation.difference_range_bias_sigma_m", at_least=0.0, default=0.05
    )


@pytree
class ServicerTuning:
    """Belief of flight software in one servicer, or in several along a further axis.

    Attributes:
        filter: numbers of its orbit filter
        focal_px: () of its camera [px]
    """

    filter: OrbitFilterTuning
    focal_px: Array


@dataclass(frozen=True)
class Link:
    """What is the same for all servicers and all ticks of an exchange of messages.

    Attributes:
        settings: static settings
        baseline: belief in differences of GPS positions, and in ranges over the links
        tick_s: camera period [s]
    """

    settings: LinkSettings
    baseline: BaselineTuning
    tick_s: float

    @property
    def delay(self) -> float:
        """Age of the messages that arrive [s]."""
        return self.settings.delay_ticks * self.tick_s
