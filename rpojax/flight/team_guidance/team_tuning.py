"""Numbers of the guidance of a team."""

from jaxtyping import Array

from rpojax.core.pytree import pytree


@pytree
class TeamTuning:
    """Numbers of the guidance of a team, the same for all servicers.

    Attributes:
        keep_out: () radius around another servicer's free drift that no burn may lead into [m]
    """

    keep_out: Array
