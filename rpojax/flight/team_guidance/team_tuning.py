"""Numbers of the guidance of a team."""

from jaxtyping import Array

from rpojax.core.pytree import pytree


@pytree
class TeamTuning:
    """Numbers of the guidance of a team, the same for all servicers.

    Attributes:
        keep_out: () radius around another servicer's free drift that no burn may lead into [m]
        lost_after: () age of the latest message of a servicer after which it is left out [s]
        phase_rate: () at which relative orbits shift [rad/s]
        view_incidence: () greatest angle at which a side of the target counts as seen [rad]
        view_sun_incidence: () the same for sunlight [rad]
        view_memory: () time after which most of what was seen is worth seeing again [s]
        keeping_delta_v: () what a servicer needs without a shift, in the time for which viewpoints are chosen [m/s]
    """

    keep_out: Array
    lost_after: Array
    phase_rate: Array
    view_incidence: Array
    view_sun_incidence: Array
    view_memory: Array
    keeping_delta_v: Array
