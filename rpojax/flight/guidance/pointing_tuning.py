"""Tuning of the attitude guidance, and all of guidance that does not change from tick to tick."""

from dataclasses import dataclass

from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.vehicle_model import VehicleModel


@pytree
class PointingTuning:
    """Slew and search parameters.

    Attributes:
        slew_acceleration: () peak angular acceleration of a planned slew [rad/s^2]
        slew_minimum_time: () [s]
        settle_time: () between the end of a slew and the burn [s]
        look_away_limit: () from the start of the turn to the end of the turn back [s]
        search_after: () time without an accepted box after which a search begins, look-aways left out [s]
        acquisition_wait: () the same before the target is acquired [s]
        search_pitch: () distance between turns of the search spiral [rad]
        search_acceleration: () centripetal acceleration along the spiral [rad/s^2]
        search_sigmas: () the spiral restarts beyond this many sigma of projected uncertainty [-]
        search_radius_max: () largest radius of the spiral [rad]
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


@dataclass(frozen=True, eq=False)
class GuidanceSoftware:
    """Guidance of one servicer: what does not change from tick to tick.

    Attributes:
        pointing: tuning of the attitude guidance
        formation: tuning of formation keeping
        vehicle: nominal properties of the servicer
        tick_s: time between guidance ticks [s]
    """

    pointing: PointingTuning
    formation: FormationTuning
    vehicle: VehicleModel
    tick_s: float
