"""Records of the initial relative state, the errors of the hand-over, and the limits of a run."""

from jaxtyping import Array

from rpojax.core.declared_numbers import declared_numbers, number
from rpojax.core.pytree import pytree
from rpojax.value_types import NonNegative, NonNegativeVector

_ONE_OR_THREE = NonNegative | NonNegativeVector


@pytree
class InitialRelativeState:
    """Initial state of the servicer relative to the target."""

    relative_position: Array = number("position of the servicer from the target at the start, H", unit="m", length=3)
    relative_velocity: Array = number("rate of change of that position as seen in H", unit="m_s", length=3)


@pytree
class HandoverErrors:
    """True errors of the orbits at hand-over, of position and inertial velocity along the axes of H.

    A group without a value has the sigma that the filter is told.

    Attributes:
        covariance_factor: (12, 12) root of the covariance of all four, in place of sigmas
    """

    position_sigma: Array | None = number(
        "error of the servicer's position, 1 sigma: one for all axes or three along those of H",
        key="initial.handover.position_sigma_m",
        form=_ONE_OR_THREE,
        default=None,
    )
    velocity_sigma: Array | None = number(
        "the same of its inertial velocity",
        key="initial.handover.velocity_sigma_m_s",
        form=_ONE_OR_THREE,
        default=None,
    )
    relative_position_sigma: Array | None = number(
        "the same of its position from the target",
        key="initial.handover.relative_position_sigma_m",
        form=_ONE_OR_THREE,
        default=None,
    )
    relative_velocity_sigma: Array | None = number(
        "the same of its inertial velocity less the target's",
        key="initial.handover.relative_velocity_sigma_m_s",
        form=_ONE_OR_THREE,
        default=None,
    )
    covariance_factor: Array | None = None


HANDOVER_KEYS = tuple(key.rpartition(".")[2] for key, _ in declared_numbers(HandoverErrors).values())
"""Keys of the section of these errors, and with `initial_` before them of what the filter is told."""


@pytree
class Limits:
    """Limits of which the outcome of a run depends."""

    keep_out: Array = number(
        "radius of the sphere around the target; a run ends and fails when the range is smaller", unit="m", at_least=0.0
    )
    lost_after: Array = number(
        "time without an accepted box of the target, while it should be seen, after which it is lost",
        unit="s",
        above=0.0,
        default=600.0,
    )
    off_station: Array = number(
        "distance from the desired position beyond which the servicer is off station", unit="m", above=0.0, default=10.0
    )
    arrive_by: Array = number(
        "time since the start from which `off_station_m` is judged; the last tick counts as the end of the run",
        unit="s",
        at_least=0.0,
        default=3000.0,
    )
    propellant: Array = number(
        "propellant that the servicer may use; without it the thruster gives no thrust",
        unit="kg",
        above=0.0,
        default=1e9,
    )
