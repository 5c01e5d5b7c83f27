"""Static settings of the messages between servicers, and what flight software believes of their baselines."""

from dataclasses import dataclass
from typing import Literal

from jaxtyping import Array

from rpojax.core.pytree import pytree

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


@pytree
class BaselineTuning:
    """Belief of flight software in differences of two servicers' GPS positions, and in their range over the link.

    Attributes:
        noise: () white noise per axis, 1 sigma [m]
        error_sigma: () slowly varying error per axis, 1 sigma [m]
        error_time_constant: () its correlation time [s]
        range_noise: () white noise of a range over the link, 1 sigma [m]
        range_bias_sigma: () its constant bias, 1 sigma [m]
    """

    noise: Array
    error_sigma: Array
    error_time_constant: Array
    range_noise: Array
    range_bias_sigma: Array
