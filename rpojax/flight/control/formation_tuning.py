"""Tuning of formation keeping."""

from jaxtyping import Array

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree


@pytree
class FormationTuning:
    """Desired position, LQR weights and conditions for a burn.

    Attributes:
        dead_band_slope: () width over the dead band of the slope that its edge has in derivatives; infinite for the
            step that it is. No value depends on it [-]
    """

    desired_position: Array = number(
        "desired position of the servicer relative to the target, in H; outside of `limits.keep_out_m`",
        unit="m",
        length=3,
    )
    position_weight: Array = number(
        "LQR weight of the squared position error, per burn [1/m^2]", length=3, at_least=0.0
    )
    velocity_weight: Array = number(
        "LQR weight of the squared velocity error, per burn [s^2/m^2]", length=3, at_least=0.0
    )
    delta_v_weight: Array = number("LQR weight of the squared velocity change, per burn [s^2/m^2]", length=3, above=0.0)
    lead: Array = number(
        "time from the decision to the middle of the burn; at least half of `pointing.look_away_limit_s`, and at most "
        "`rates.formation_period_s` less that half",
        unit="s",
        at_least=0.0,
    )
    dead_band: Array = number("velocity change below which no burn is made", unit="mm_s", at_least=0.0)
    dead_band_slope: Array
    range_uncertainty_limit: Array = number("no burn above this ratio of 1-sigma range error to range", above=0.0)
    thruster_retry: Array = number("waiting time after a burn without thrust", unit="s", at_least=0.0)
