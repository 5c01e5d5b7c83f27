"""Conditions of a burn: the target is known well enough, will stay in the light, and the thruster works."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.yamanaka_ankersen import advanced
from rpojax.flight.decisions.motion_prediction import Prediction
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import attitude_guidance, burn_schedule, target_visibility
from rpojax.flight.navigation.box_measurement import detection_model

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]


def thruster_works(params: FlightParams, memory: FlightMemory, time: Scalar) -> Flag:
    """False for a while after a burn that gave no thrust."""
    return time >= memory.thruster_failed_at + params.formation.thruster_retry


def is_lost(params: FlightParams, memory: FlightMemory) -> Flag:
    """True without a box of the target for so long that no burn should be based on the estimate."""
    acquisition = memory.pointing.acquisition
    missing = acquisition.unseen_time > params.health.unseen_limit
    return jnp.where(
        may_be_too_small(params, memory),
        missing | ~acquisition.acquired,
        attitude_guidance.is_lost(params.pointing, memory.pointing),
    )


def may_be_too_small(params: FlightParams, memory: FlightMemory) -> Flag:
    """True if the target appears so small that frames without a box are no sign of its loss."""
    relative, focal_px = memory.orbit.relative, params.seen_through(memory.lens).vehicle.focal_px
    return detection_model.may_be_too_small(params.navigation, focal_px, relative.r_TS_N, relative.slow["size"][0])


def time_to_stop(software: FlightSoftware, stop_H: Vector, period: Scalar) -> Scalar:
    """Time [s] in which burns, one each `period` [s], can have made a velocity change [m/s] that stops the motion."""
    certain = burn_schedule.certain_delta_v(software.guidance)
    # A thruster that cannot burn in every direction within the limit gives no measure.
    burns_to_stop = jnp.where(
        certain > 0.0, _BURNS_PER_STOP * gradient_safe.norm(stop_H) / jnp.where(certain > 0.0, certain, 1.0), 0.0
    )
    return jnp.maximum(_BURNS_BEFORE_DARKNESS, _SPARE_BURNS + burns_to_stop) * period


def stays_visible(
    params: FlightParams, memory: FlightMemory, predicted: Prediction, sun_N: Vector, after: Scalar
) -> Flag:
    """Whether the target is still visible a time [s] after the burn, with the Sun at `sun_N` [m]."""
    then = advanced(predicted.burn_orbit, after)
    angle = then.argument_of_latitude - predicted.orbit.argument_of_latitude
    return target_visibility.is_in_sight_after(params.vehicle, memory.orbit, sun_N, angle)


_BURNS_BEFORE_DARKNESS = 3.0
"""Burns before the target is out of sight that stop the relative motion, at least: the last one may fail [-]. A choice:
alone they did not stop servicers at 0.2 m/s (experiments/unseen_missions)."""


_BURNS_PER_STOP = 2.0
"""Burns to stop a motion, over those that would take its speed away at once: it turns meanwhile [-]. A choice."""


_SPARE_BURNS = 2.0
"""Burns besides these [-]. A choice: one that fails, and one that corrects the last error."""
