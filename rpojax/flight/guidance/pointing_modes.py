"""Tuning of the attitude guidance, and the modes in which it flies."""

import enum

from jaxtyping import Array

from rpojax.core.pytree import pytree


class Mode(enum.IntEnum):
    """What the body is doing; a turn to a target whose estimate has jumped counts as search."""

    LOOK = 0
    TURN = 1
    BURN = 2
    TURN_BACK = 3
    SEARCH = 4


@pytree
class PointingTuning:
    """Slew and search parameters.

    Attributes:
        slew_acceleration: () peak angular acceleration of a planned slew [rad/s^2]
        slew_minimum_time: () [s]
        settle_time: () between the end of a slew and the burn [s]
        look_away_limit: () from the start of the turn to the end of the turn back [s]
        search_after: () seconds without an accepted box, outside planned look-aways [s]
        acquisition_wait: () the same before the first accepted box of the run [s]
        search_pitch: () distance between turns of the search spiral [rad]
        search_acceleration: () centripetal acceleration along the spiral [rad/s^2]
        search_sigmas: () the spiral starts anew beyond this many sigma of projected uncertainty [-]
        search_radius_max: () and beyond this angle at any rate [rad]
        burn_attitude_limit: () no thrust while the attitude is further from the burn's [rad]
    """

    slew_acceleration: Array
    slew_minimum_time: Array
    settle_time: Array
    look_away_limit: Array
    search_after: Array
    acquisition_wait: Array
    search_pitch: Array
    search_acceleration: Array
    search_sigmas: Array
    search_radius_max: Array
    burn_attitude_limit: Array
