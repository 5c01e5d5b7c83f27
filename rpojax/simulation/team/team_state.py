"""State of a run of a team between ticks."""

from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.team_guidance.coordination import Coordination
from rpojax.simulation.state import State


@pytree
class LinkState:
    """State of the links and of the receivers' differences.

    Attributes:
        in_burst: (N, N) bool, whether a link from sender (column) to receiver (row) is in a burst of losses
        carrier_error_N: (3, N) slow error of each receiver's position by carrier phase [m]
        range_bias: (N, N) biases of the ranges over the links [m], None if ranges are not measured
    """

    in_burst: Array
    carrier_error_N: Array
    range_bias: Array | None = None


@pytree
class TeamState:
    """State of a team at the beginning of a tick.

    Attributes:
        servicers: states (..., N) of the servicers; the number of the tick is one for all, and each has the target's
            truth, which is the same
        links: of the radio links, None if nothing is shared
        sharing: what the servicers know of each other (..., N), None if nothing is shared
        coordination: what they told each other of their plans (..., N), None unless they are coordinated
    """

    servicers: State
    links: LinkState | None = None
    sharing: SharingMemory | None = None
    coordination: Coordination | None = None

    @property
    def failure(self) -> Array:
        """(N,) code of the outcome that froze each servicer, else 0."""
        return self.servicers.failure

    @property
    def failed_at(self) -> Array:
        """(N,) when [s], infinite for one that has not failed."""
        return self.servicers.failed_at
