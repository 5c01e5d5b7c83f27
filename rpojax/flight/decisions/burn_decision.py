"""Burn decision: the next velocity change from the control law, made safe, and scheduled between two turns."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.keplerian_elements import mean_motion, semi_major_axis
from rpojax.core.vectors import apply_transposed
from rpojax.flight.control import formation_law, reference_governor
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import (
    approach_inhibition,
    attitude_guidance,
    burn_planning,
    line_of_sight_uncertainty,
    target_pointing,
    target_visibility,
)
from rpojax.flight.guidance.approach_inhibition import Approach, Confidence
from rpojax.flight.guidance.burn_planning import BurnPlan, StateAtBurn
from rpojax.flight.guidance.target_pointing import TargetPointing
from rpojax.flight.navigation.box_measurement import detection_model

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


def plan_burn(software: FlightSoftware, memory: FlightMemory, pointing: TargetPointing, time: Scalar) -> BurnPlan:
    """Next burn; none while the target is lost or dark, the range too uncertain, or soon after the thruster failed."""
    params = software.params
    at_burn = burn_planning.state_at_burn(params.formation, memory.orbit)
    command_H = _formation_command(software, memory, at_burn, pointing.q_BN, time)
    known = line_of_sight_uncertainty.relative_range_sigma(memory.orbit) < params.formation.range_uncertainty_limit
    wanted_H = memory.station_keeping.impulse + command_H
    return burn_planning.schedule_burn(
        software.guidance,
        apply_transposed(at_burn.R_CN, _safe_delta_v(software, memory, at_burn, pointing, wanted_H)),
        pointing.q_BN,
        pointing.visible & thruster_works(params, memory, time) & ~is_lost(params, memory) & known,
        time,
    )


def formation_command(software: FlightSoftware, memory: FlightMemory, time: Scalar) -> Vector:
    """Velocity change [m/s] by the control law in the Hill frame C at the next burn's middle.

    The law gets as much of the along-track deviation as the thruster can follow.
    """
    params = software.params
    q_look, _ = target_pointing.look_attitude(params.vehicle, memory.orbit, memory.pointing.reference.q_EN)
    at_burn = burn_planning.state_at_burn(params.formation, memory.orbit)
    return _formation_command(software, memory, at_burn, q_look, time)


def _formation_command(
    software: FlightSoftware, memory: FlightMemory, at_burn: StateAtBurn, q_look: Float[Array, "4"], time: Scalar
) -> Vector:
    params = software.params
    impulse = memory.station_keeping.impulse
    desired_H = jnp.concatenate([params.formation.desired_position, memory.station_keeping.arrival_velocity])
    deviation = at_burn.state_H - desired_H
    wanted_N = apply_transposed(at_burn.R_CN, impulse + formation_law.lqr_feedback(memory.gain, deviation))
    limit = burn_planning.largest_delta_v(software.guidance, wanted_N, q_look)
    governed = reference_governor.govern(memory.gain, deviation, impulse, limit)
    return software.stages.call(
        "formation_law", memory.own, gain=memory.gain, deviation=governed, estimate=memory.orbit, time=time
    )


def _safe_delta_v(
    software: FlightSoftware,
    memory: FlightMemory,
    at_burn: StateAtBurn,
    pointing: TargetPointing,
    wanted_H: Vector,
) -> Vector:
    """Velocity change [m/s] of the next burn: that of the law, a stop before darkness, or one that comes less near."""
    params, period = software.params, software.formation_period_s
    formation, orbit = params.formation, memory.orbit
    r_TN_N, v_TN_N = orbit.servicer.r_SN_N + orbit.relative.r_TS_N, orbit.servicer.v_SN_N + orbit.relative.v_TS_N
    n = mean_motion(semi_major_axis(r_TN_N, v_TN_N))
    certain = burn_planning.certain_delta_v(software.guidance)
    stop = gradient_safe.norm(approach_inhibition.change_to_stop(at_burn.state_H, n))
    # A thruster that cannot burn in every direction within the limit gives no measure.
    burns_to_stop = jnp.where(certain > 0.0, _BURNS_PER_STOP * stop / jnp.where(certain > 0.0, certain, 1.0), 0.0)
    burns = jnp.maximum(_BURNS_BEFORE_DARKNESS, 2.0 + burns_to_stop)
    stays_visible = target_visibility.is_visible_after(
        params.vehicle, orbit, pointing.sun_N, n * (formation.lead + burns * period)
    )
    approach = Approach(
        station_H=formation.desired_position, state_H=at_burn.state_H, stays_visible=stays_visible, n=n, period=period
    )
    confidence = Confidence(
        present=memory.health.confident,
        last_range=memory.health.confident_range,
        range_sigma=line_of_sight_uncertainty.relative_range_sigma(orbit) * gradient_safe.norm(orbit.relative.r_TS_N),
    )
    return approach_inhibition.inhibit(params.health.clearance, approach, confidence, wanted_H, certain)


def is_lost(params: FlightParams, memory: FlightMemory) -> Bool[Array, ""]:
    """True without a box of the target for so long that no burn should be based on the estimate."""
    acquisition = memory.pointing.acquisition
    missing = acquisition.unseen_time > params.health.unseen_limit
    return jnp.where(
        may_be_too_small(params, memory),
        missing | ~acquisition.acquired,
        attitude_guidance.is_lost(params.pointing, memory.pointing),
    )


def may_be_too_small(params: FlightParams, memory: FlightMemory) -> Bool[Array, ""]:
    """True if the target appears so small that frames without a box are no sign of its loss."""
    relative = memory.orbit.relative
    return detection_model.may_be_too_small(
        params.navigation, params.vehicle.focal_px, relative.r_TS_N, relative.slow["size"][0]
    )


def thruster_works(params: FlightParams, memory: FlightMemory, time: Scalar) -> Bool[Array, ""]:
    """False for a while after a burn that gave no thrust."""
    return time >= memory.thruster_failed_at + params.formation.thruster_retry


_BURNS_BEFORE_DARKNESS = 3.0
"""Burns before the target is out of sight that stop the relative motion, at least: the last one may fail [-]."""


_BURNS_PER_STOP = 2.0
"""Burns to stop a motion, over those that would take its speed away at once: it turns meanwhile [-]."""
