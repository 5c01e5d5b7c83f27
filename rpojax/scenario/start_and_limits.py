"""Records of the initial relative state, the errors of the hand-over, and the limits of a run."""

from jaxtyping import Array

from rpojax.core.pytree import pytree


@pytree
class InitialRelativeState:
    """Initial state of the servicer relative to the target.

    Attributes:
        relative_position: (3,) rho_H [m]
        relative_velocity: (3,) rho_dot_H [m/s]
    """

    relative_position: Array
    relative_velocity: Array


@pytree
class HandoverErrors:
    """True errors of the orbits at hand-over, of position and inertial velocity along the axes of H.

    A group without a value has the sigma that the filter is told.

    Attributes:
        position_sigma: () or (3,) of the servicer [m]
        velocity_sigma: () or (3,) of the servicer [m/s]
        relative_position_sigma: () or (3,) of the servicer from the target [m]
        relative_velocity_sigma: () or (3,) of the servicer from the target [m/s]
        covariance_factor: (12, 12) root of the covariance of all four, in place of sigmas
    """

    position_sigma: Array | None = None
    velocity_sigma: Array | None = None
    relative_position_sigma: Array | None = None
    relative_velocity_sigma: Array | None = None
    covariance_factor: Array | None = None


@pytree
class Limits:
    """Limits of which the outcome of a run depends.

    Attributes:
        keep_out: () radius of the sphere around the target that the servicer must not enter [m]
        lost_after: () time without a box of the target, while it should be seen, after which it is lost [s]
        off_station: () distance from the desired position beyond which the servicer is off station [m]
        arrive_by: () time since the start from which that is judged [s]
        propellant: () that the thruster may use [kg]
    """

    keep_out: Array
    lost_after: Array
    off_station: Array
    arrive_by: Array
    propellant: Array
