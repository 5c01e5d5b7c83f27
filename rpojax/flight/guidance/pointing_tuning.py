"""Tuning of the attitude guidance, and all of guidance that does not change from tick to tick."""

from dataclasses import dataclass

from jaxtyping import Array

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.vehicle_model import VehicleModel


@pytree
class PointingTuning:
    """Slew and search parameters."""

    slew_acceleration: Array = number("peak angular acceleration of a planned slew", unit="mrad_s2", above=0.0)
    slew_minimum_time: Array = number("shortest slew", unit="s", above=0.0)
    settle_time: Array = number("between the end of a slew and the burn", unit="s", at_least=0.0)
    look_away_limit: Array = number(
        "from the start of the turn to the end of the turn back; at most `rates.formation_period_s`",
        unit="s",
        above=0.0,
    )
    search_after: Array = number("search starts after this time without box, look-aways left out", unit="s", above=0.0)
    acquisition_wait: Array = number("the same before the first box of a run", unit="s", above=0.0)
    search_pitch: Array = number("distance between turns of the search spiral", unit="deg", above=0.0)
    search_acceleration: Array = number("centripetal acceleration along the spiral", unit="mrad_s2", above=0.0)
    search_sigmas: Array = number("the spiral restarts beyond this many sigma of projected uncertainty", above=0.0)
    search_radius_max: Array = number("largest radius of the spiral", unit="deg", above=0.0, below=180.0)
    burn_attitude_limit: Array = number("no thrust above this attitude error", unit="deg", above=0.0, below=180.0)


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
