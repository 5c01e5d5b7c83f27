"""Translation without turns: the velocity change of a tick by which a reference is followed all the time."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.frames import hill_frame
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.pytree import replace
from rpojax.core.vectors import apply_transposed
from rpojax.flight.control import formation_law, plume_rule, rcs_control
from rpojax.flight.decisions import burn_conditions, phase_goal
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightMemory
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import line_of_sight_uncertainty, target_frame
from rpojax.flight.mission.phase_table import constant_of_phase, of_phase

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


def is_translating(software: FlightSoftware, memory: FlightMemory) -> Bool[Array, ""]:
    """Whether the present phase uses the reaction control system."""
    return constant_of_phase(memory.mission.phase, software.mission.translates)


def command(software: FlightSoftware, memory: FlightMemory, wheel_speed: Vector, time: Scalar) -> FlightMemory:
    """Memory with the command of the reaction control system for the tick that begins at `time` [s].

    A phase with continuous control follows its reference by linear feedback and feed-forward of what its free motion
    lacks; it drifts while nothing shows the target. After an abort the planned burn is made, if there is one.
    """
    thrusters, settings = software.params.thrusters, software.mission
    assert thrusters is not None
    assert memory.rcs is not None
    has_aborted = memory.mission.phase == settings.aborted
    followed_N = jnp.where(may_follow(software, memory), _following(software, memory, time), 0.0)
    plan = memory.plan
    duration = jnp.maximum(plan.cutoff - plan.ignition, software.tick_s)
    overlap = jnp.minimum(time + software.tick_s, plan.cutoff) - jnp.maximum(time, plan.ignition)
    planned_N = jnp.maximum(overlap, 0.0) / duration * plan.delta_v_N
    to_target_B = quaternion.rotate(memory.attitude.q_BN, memory.orbit.relative.r_TS_N)
    may_fire = plume_rule.may_fire(software.params.plume_rule, thrusters, to_target_B, has_aborted)
    rcs = rcs_control.command(
        thrusters,
        rcs_control.with_propellant_used(software.params.vehicle, memory.rcs),
        memory.rcs,
        memory.attitude.q_BN,
        jnp.where(has_aborted, planned_N, followed_N),
        wheel_speed,
        is_translating(software, memory),
        may_fire,
        software.tick_s,
    )
    return replace(memory, rcs=rcs)


def may_follow(software: FlightSoftware, memory: FlightMemory) -> Bool[Array, ""]:
    """Whether the estimate is good enough to follow the reference of the present phase by it.

    To a target that turns there is no rest: a servicer in its frame goes on by what it knows of position and attitude
    while it cannot be seen, as with the Sun in the lens.
    """
    params, relative = software.params, memory.orbit.relative
    sees = ~burn_conditions.is_lost(params, memory)
    if relative.target is None or not any(software.mission.in_target_frame):
        return sees
    is_expected_unseen = memory.pointing.acquisition.unseen_time <= params.pointing.search_after
    ratio = line_of_sight_uncertainty.relative_range_sigma(memory.orbit)
    bridges = is_expected_unseen & (ratio < params.formation.range_uncertainty_limit)
    turns = constant_of_phase(memory.mission.phase, software.mission.in_target_frame)
    return jnp.where(turns, relative.target.certain & (sees | bridges), sees)


def _following(software: FlightSoftware, memory: FlightMemory, time: Scalar) -> Vector:
    """Velocity change of a tick in N [m/s] that follows the reference of the present phase."""
    predicted, state = predict_to_burn(software.params, memory.orbit), memory.mission
    tick = jnp.full_like(time, software.tick_s)
    later = yamanaka_ankersen.advanced(predicted.orbit, tick)
    now = predicted.target_frame
    then = None if now is None else target_frame.ahead(now, predicted.orbit, later, software.tick_s)
    desired = phase_goal.desired_state(software, state, predicted.orbit, now, time)
    next_desired = phase_goal.desired_state(software, state, later, then, time + tick)
    constants = yamanaka_ankersen.constants_of_motion(predicted.orbit, desired)
    free = yamanaka_ankersen.free_motion(later, tick, constants)
    gain = of_phase(state.phase, [each[0] for each in memory.phase_gains])
    delta_v_H = next_desired[3:] - free[3:] + formation_law.lqr_feedback(gain, predicted.state_H - desired)
    relative, servicer = memory.orbit.relative, memory.orbit.servicer
    R_HN, _ = hill_frame(servicer.r_SN_N + relative.r_TS_N, servicer.v_SN_N + relative.v_TS_N)
    return apply_transposed(R_HN, delta_v_H)


def burn_duration(software: FlightSoftware, delta_v_N: Vector) -> Scalar:
    """Time [s] in which the reaction control system makes a velocity change [m/s] in any direction."""
    thrusters, mass = software.params.thrusters, software.params.vehicle.mass
    assert thrusters is not None
    return gradient_safe.norm(delta_v_N) * mass / thrusters.authority
