"""Tuning of formation keeping."""

from jaxtyping import Array

from rpojax.core.pytree import pytree


@pytree
class FormationTuning:
    """Desired position, LQR weights and conditions for a burn.

    Attributes:
        desired_position: (3,) servicer from target in H [m]
        position_weight: (3,) weight of the squared position deviation per burn [1/m^2]
        velocity_weight: (3,) weight of the squared velocity deviation per burn [s^2/m^2]
        delta_v_weight: (3,) weight of the squared velocity change per burn [s^2/m^2]
        lead: () from the decision to the middle of the burn [s]
        dead_band: () smaller velocity changes are not made [m/s]
        range_uncertainty_limit: () no burn above this ratio of 1-sigma range error to range [-]
        thruster_retry: () waiting time after a burn that gave no thrust [s]
    """

    desired_position: Array
    position_weight: Array
    velocity_weight: Array
    delta_v_weight: Array
    lead: Array
    dead_band: Array
    range_uncertainty_limit: Array
    thruster_retry: Array
