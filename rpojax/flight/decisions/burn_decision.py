"""Burn decision: the velocity change that the control law plans for a phase, made safe, or an abort burn."""

from functools import partial
from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree, replace, select
from rpojax.core.vectors import apply_transposed
from rpojax.flight.control import formation_law, periodic_lqr_gain, reference_governor
from rpojax.flight.decisions import burn_conditions, phase_goal, translation
from rpojax.flight.decisions.mission_decision import is_passively_safe, keep_out_zone
from rpojax.flight.decisions.motion_prediction import Prediction, predict_to_burn
from rpojax.flight.decisions.phase_goal import Goal
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import burn_schedule, target_pointing
from rpojax.flight.guidance.burn_schedule import BurnPlan
from rpojax.flight.guidance.target_pointing import TargetPointing
from rpojax.flight.mission import abort_burn, drift_clearance, hold_in_doubt, safe_burn, team_mission_state
from rpojax.flight.mission.drift_clearance import Drift
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.mission.phase_table import constant_of_phase, of_phase
from rpojax.flight.mission.safe_burn import SafeBurn
from rpojax.flight.mission.static_mission_settings import MissionSettings
from rpojax.flight.mission.team_mission_state import TeamMission
from rpojax.flight.navigation import burn_execution_error
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.team_guidance import peer_drift, team_knowledge
from rpojax.flight.team_guidance.peer_drift import NextBurn, PeerDrifts
from rpojax.flight.team_guidance.team_knowledge import KnownPeers
from rpojax.flight.team_guidance.team_situation import TeamTuning

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]


@pytree
class Team:
    """What a servicer of a team decides with, beyond what it knows alone.

    Attributes:
        tuning: numbers of the guidance of the team
        peers: what it knows of the others
    """

    tuning: TeamTuning
    peers: KnownPeers


@pytree
class Decision:
    """What a burn is decided by.

    Attributes:
        time: () since the start of the run [s]
        memory: of the flight software
        predicted: relative motion now and at the burn
        pointing: attitude towards the target
        team: the others and how to keep clear of them, None for a servicer that decides alone
    """

    time: Array
    memory: FlightMemory
    predicted: Prediction
    pointing: TargetPointing
    team: Team | None = None


def plan_burn(software: FlightSoftware, decision: Decision) -> tuple[BurnPlan, MissionState]:
    """Next burn of the present phase, at a time at which the phase decides about burns.

    The burn that the control law plans is made as far as the free motion after it stays clear of the keep-out zone and
    of the free motions of the others in a `team`: for two control periods, or in a passively safe phase for the whole
    horizon; else another one is made. Before the target gets dark the motion is stopped, and judged over an orbit.
    There is no burn while the target is lost or dark, its range is too uncertain, or soon after the thruster failed;
    but a station that is handed over in the dark burns as long as its drift may lead into the zone.
    After an abort there is one burn, if that is needed, and another one only for what was measured since. Returned
    beside the burn is the state of the mission with its records of these decisions.
    """
    settings, params, team, time = software.mission, software.params, decision.team, decision.time
    if team is not None and settings.phasing != "fixed":
        shifted = _with_phase_of_team(software, decision, team)
        decision = replace(decision, memory=replace(decision.memory, mission=shifted))
    memory, predicted, pointing = decision.memory, decision.predicted, decision.pointing
    state = memory.mission
    period = _period(settings, state, software.tick_s)
    stop_H = hold_in_doubt.change_to_stop(predicted.burn_state_H, predicted.burn_orbit)
    until_stopped = burn_conditions.time_to_stop(software, stop_H, period)
    visible = burn_conditions.stays_visible(params, memory, predicted, pointing.sun_N, until_stopped)
    waits = [*(phase.stops_in_the_dark for phase in settings.phases), True, False]
    stops = ~visible & constant_of_phase(state.phase, waits)
    planned_H = jnp.where(stops, stop_H, _planned_delta_v(software, decision, period))
    works = burn_conditions.thruster_works(params, memory, time)
    known = predicted.range_ratio_sigma < params.formation.range_uncertainty_limit
    sees = pointing.visible & ~burn_conditions.is_lost(params, memory) & known
    is_blind = _is_blind(software, decision) & known
    drift = _drift_after_burn(software, decision, stops, period, is_blind)
    greatest = _certain_delta_v(software, memory, period)
    if not settings.is_managed:
        planned_H = _within_limit(software, predicted, pointing, jnp.where(sees, planned_H, 0.0))
        burn_H = safe_burn.safe_delta_v(drift, planned_H, greatest, ~stops, improves=True)
        return _scheduled(software, decision, burn_H, (sees | is_blind) & works), state
    trusts, has_aborted = sees & memory.health.confident, state.phase == settings.aborted
    keeps = trusts & ~has_aborted
    was_made = _is_made(software, memory, time)
    after_abort = abort_burn.permission(state.abort_burns, has_aborted, works, trusts, was_made)
    planned_H = _within_limit(software, predicted, pointing, jnp.where(keeps, planned_H, 0.0))
    may_wait = is_passively_safe(settings, state) & ~after_abort.of_abort
    can_burn = (keeps & works) | after_abort.of_abort | after_abort.of_sight
    decided = state.team
    if team is None or decided is None or not settings.keeps_clear:
        burn_H = safe_burn.safe_delta_v(drift, planned_H, greatest, may_wait, near_sigma=_near_sigma(software))
    else:
        in_light = _drift_after_burn(software, decision, jnp.zeros_like(stops), period, is_blind)
        others = _others(software, decision, in_light, team)
        burn = safe_burn.safe_delta_v_among(drift, others, planned_H, greatest, may_wait)
        burn_H, decided = burn.delta_v_H, _decided(decided, burn, team, can_burn, time)
    plan = _scheduled(software, decision, burn_H, can_burn)
    burns = abort_burn.recorded(state.abort_burns, after_abort, plan.cutoff > plan.ignition, was_made)
    return plan, replace(state, team=decided, abort_burns=burns)


def formation_command(software: FlightSoftware, memory: FlightMemory, time: Scalar) -> Vector:
    """Velocity change [m/s] by the control law alone, in the Hill frame at a burn that is decided at `time` [s]."""
    q_look, _ = target_pointing.look_attitude(software.params.vehicle, memory.orbit, memory.pointing.reference.q_EN)
    period = _period(software.mission, memory.mission, software.tick_s)
    return _command(software, memory, predict_to_burn(software.params, memory.orbit), q_look, time, period)[1]


def _is_blind(software: FlightSoftware, decision: Decision) -> Flag:
    """Whether a station was handed over in the dark, and nothing has been seen of the target since."""
    is_station = jnp.asarray(not software.mission.is_managed)
    return is_station & ~decision.pointing.visible & outlier_gate.is_without_boxes(decision.memory.gate)


def _certain_delta_v(software: FlightSoftware, memory: FlightMemory, period: Scalar) -> Scalar:
    """Velocity change [m/s] that a burn can make in any direction."""
    with_turns = burn_schedule.certain_delta_v(software.guidance)
    if software.params.thrusters is None:
        return with_turns
    without = software.params.thrusters.authority / software.params.vehicle.mass * period
    return jnp.where(translation.is_translating(software, memory), without, with_turns)


def _scheduled(software: FlightSoftware, decision: Decision, burn_H: Vector, can_burn: Flag) -> BurnPlan:
    """Schedule of a velocity change [m/s]: between turns, or at once by the reaction control system."""
    delta_v_N, q_look = apply_transposed(decision.predicted.R_CN, burn_H), decision.pointing.q_BN
    plan = burn_schedule.schedule_burn(software.guidance, delta_v_N, q_look, can_burn, decision.time)
    if software.params.thrusters is None:
        return plan
    on_time = jnp.where(can_burn, translation.burn_duration(software, delta_v_N), 0.0)
    begin = decision.time + software.params.formation.lead - 0.5 * on_time
    straight = burn_schedule.straight_burn(delta_v_N, q_look, jnp.maximum(begin, decision.time), on_time)
    return select(translation.is_translating(software, decision.memory), straight, plan)


def is_due(settings: MissionSettings, state: MissionState, time: Scalar, tick_s: float) -> Flag:
    """Whether `time` [s] is one of the times at which the present phase decides about burns."""
    period = _period(settings, state, tick_s)
    since = time - state.entered_at
    is_time = jnp.abs(since - period * jnp.round(since / period)) < 0.5 * tick_s
    if not any(settings.translates):
        return is_time
    follows = constant_of_phase(state.phase, settings.translates) & (state.phase != settings.aborted)
    return is_time & ~follows


def _period(settings: MissionSettings, state: MissionState, tick_s: float) -> Scalar:
    """Time between decisions about burns in the present phase [s]."""
    return constant_of_phase(state.phase, settings.control_ticks) * tick_s


def _within_limit(
    software: FlightSoftware, predicted: Prediction, pointing: TargetPointing, planned_H: Vector
) -> Vector:
    """A planned velocity change [m/s] as the look-away limit shortens it: so it is judged."""
    planned_N = apply_transposed(predicted.R_CN, planned_H)
    share = burn_schedule.share_within_limit(software.guidance, planned_N, pointing.q_BN)
    return planned_H * share


def _near_sigma(software: FlightSoftware) -> Scalar | None:
    """That error in missions that come within metres of the zone, those with continuous control; else None."""
    return _execution_sigma(software.params) if any(software.mission.translates) else None


def _execution_sigma(params: FlightParams) -> Scalar:
    """New execution error of a burn over its size, 1 sigma [-]."""
    navigation = params.navigation
    return jnp.hypot(burn_execution_error.new_sigma(navigation), burn_execution_error.new_direction_sigma(navigation))


def _is_made(software: FlightSoftware, memory: FlightMemory, time: Scalar) -> Flag:
    """Whether the latest planned burn gave its velocity change, or may still give it after `time` [s]."""
    plan, vehicle, force = memory.plan, software.params.vehicle, software.params.vehicle.thrust
    if software.params.thrusters is not None:
        authority = software.params.thrusters.authority
        force = jnp.where(translation.is_translating(software, memory), authority, force)
    given = (jnp.minimum(plan.cutoff, time) - jnp.minimum(plan.ignition, time)) * force / vehicle.mass
    has_failed = memory.thruster_failed_at >= plan.ignition
    return abort_burn.is_made(plan.delta_v_N, given, time >= plan.cutoff, has_failed)


def _with_phase_of_team(software: FlightSoftware, decision: Decision, team: Team) -> MissionState:
    """State of the mission with the phase of the relative orbit that the team wants."""
    settings, state, predicted, time = software.mission, decision.memory.mission, decision.predicted, decision.time
    assert state.team is not None
    assert state.team.shift is not None
    before = state.team.shift
    running = state.phase < settings.hold
    row = jnp.minimum(state.phase, settings.hold - 1)
    planned = [phase_goal.planned_orbit(phase_goal.reference_of(software, phase)) for phase in settings.phases]
    situation = team_knowledge.situation(
        team.tuning,
        team.peers,
        team_knowledge.Own(
            estimate=decision.memory.orbit,
            orbit=predicted.orbit,
            state_H=predicted.state_H,
            follows=running,
            shift=before.wanted,
            shift_left=before.wanted - team_mission_state.angle(state.team, time),
            present=before.present,
            slots=of_phase(row, [team.peers.slots[number] for number in range(len(settings.phases))]),
            planned=of_phase(row, planned),
            clearance=team.tuning.keep_out + software.params.mission.abort_margin,
            sun_N=decision.pointing.sun_N,
        ),
        time,
    )
    own = decision.memory.own
    wanted = software.stages.call("team_phasing", own, settings=settings, tuning=team.tuning, team=situation)
    return replace(state, team=team_mission_state.shifted(state.team, wanted, situation.present, time))


def _others(software: FlightSoftware, decision: Decision, drift: Drift, team: Team) -> safe_burn.Clearance:
    """Clearance of the free motion after a burn, like the `drift`, from those of the others in the team."""
    state_H, covariance_H = peer_drift.relative_motion(
        decision.memory.orbit,
        team.peers,
        NextBurn(
            orbit=decision.predicted.burn_orbit,
            R_CN=decision.predicted.R_CN,
            time=decision.time,
            lead=software.params.formation.lead,
        ),
        _execution_sigma(software.params),
    )
    drifts = PeerDrifts(
        state_H=state_H,
        covariance_H=covariance_H,
        orbit=drift.orbit,
        sigmas=drift.sigmas,
        radius=team.tuning.keep_out + software.params.mission.abort_margin,
        first_span=drift.first_span,
        horizon=drift.horizon,
    )

    return partial(peer_drift.least_clearance, drifts)


def _decided(before: TeamMission, burn: SafeBurn, team: Team, can_burn: Flag, time: Scalar) -> TeamMission:
    """Record of a decision at `time` [s]; that of a servicer that `can_burn` not does not count."""
    count = team.peers.numbers.shape[0]
    number = of_phase(burn.changed_for, [team.peers.numbers[k] for k in range(count)])
    is_changed = can_burn & (burn.changed_for >= 0)
    return replace(
        before,
        changed_at=jnp.where(is_changed, time, before.changed_at),
        changed_for=jnp.where(is_changed, number, before.changed_for),
    )


def _drift_after_burn(
    software: FlightSoftware, decision: Decision, stops: Flag, period: Scalar, is_blind: Flag
) -> Drift:
    """Free motion after a burn of the present phase, passively safe or not, and what it must keep clear of.

    One that `stops` before darkness is judged over an orbit, over which no motion is certain: by the estimate alone,
    for a zone that is larger by the uncertainty of the range, or ends at the present place. One that `is_blind` is
    judged over an orbit with the uncertainty of the hand-over, whatever place that leads to.
    """
    tuning, state, predicted = software.params.mission, decision.memory.mission, decision.predicted
    is_passive = is_passively_safe(software.mission, state)
    orbit_period = drift_clearance.orbit_period(predicted.burn_orbit)
    until_seen = jnp.where(stops | is_blind, orbit_period, 2.0 * period)
    span = jnp.where(is_passive, jnp.minimum(orbit_period, tuning.abort_horizon), until_seen)
    place_H, by_estimate = predicted.burn_state_H[:3], stops
    uncertain = tuning.abort_sigmas * predicted.range_ratio_sigma * gradient_safe.norm(place_H)
    if software.mission.is_managed:
        zone = keep_out_zone(software, state) + tuning.abort_margin
    else:
        zone = _zone_of_station(software, decision)
        # Where it may drift into its zone, a servicer need not know to the last sigma that it comes no nearer.
        speed_sigma = gradient_safe.sqrt(jnp.trace(predicted.burn_covariance_H[3:, 3:]))
        reached = uncertain + tuning.abort_sigmas * span * speed_sigma
        by_estimate = ~is_blind & (stops | (gradient_safe.norm(place_H) - reached < jnp.max(zone)))
    zone = jnp.maximum(zone, drift_clearance.LEAST_SEMI_AXIS) + jnp.where(stops & ~is_blind, uncertain, 0.0)
    up_to_here = jnp.minimum(1.0, _NO_NEARER * gradient_safe.norm(place_H / zone))
    return Drift(
        orbit=predicted.burn_orbit,
        state_H=predicted.burn_state_H,
        scale_sigma=jnp.where(by_estimate, 0.0, predicted.range_ratio_sigma),
        covariance_H=jnp.where(by_estimate, 0.0, predicted.burn_covariance_H),
        sigmas=tuning.abort_sigmas,
        semi_axes=zone * jnp.where(by_estimate, up_to_here, 1.0),
        first_span=span,
        horizon=jnp.where(is_passive, jnp.maximum(span, tuning.abort_horizon), span),
    )


_NO_NEARER: Final = 0.999
"""Part of the present distance to which free motion may come that comes no nearer, but for rounding [-]: 1e-7 in single
precision, so that a thousandth is ample, and less than what is known of the place."""


def _zone_of_station(software: FlightSoftware, decision: Decision) -> Vector:
    """Semi-axes [m] of the zone that a servicer avoids at a station: larger, the farther that is.

    Without confidence in the estimate it is that of the range at which confidence was lost, if this is less.
    """
    params, health = software.params, decision.memory.health
    station = gradient_safe.norm(params.formation.desired_position)
    near = jnp.where(health.confident, station, jnp.minimum(station, health.confident_range))
    return jnp.full_like(params.formation.desired_position, params.health.clearance * near)


def _planned_delta_v(software: FlightSoftware, decision: Decision, period: Scalar) -> Vector:
    """Velocity change (3,) in H [m/s] by the control law for the reference of the present phase.

    Where nothing aborts without confidence in the estimate, a part of the change that leads to a hold is made instead.
    """
    memory, predicted, q_look = decision.memory, decision.predicted, decision.pointing.q_BN
    share = jnp.ones_like(decision.time)
    if not software.mission.is_managed:
        health, station_H = memory.health, software.params.formation.desired_position
        place = hold_in_doubt.place(station_H, predicted.burn_state_H[:3], health.confident_range)
        software = phase_goal.with_station(software, jnp.where(health.confident, station_H, place))
        share = jnp.where(health.confident, share, hold_in_doubt.SHARE_OF_CHANGE)
    goal, command_H = _command(software, memory, predicted, q_look, decision.time, period)
    return share * (goal.impulse + command_H)


def _command(
    software: FlightSoftware,
    memory: FlightMemory,
    predicted: Prediction,
    q_look: Float[Array, "4"],
    time: Scalar,
    period: Scalar,
) -> tuple[Goal, Vector]:
    """Goal of the next burn of the present phase, and the velocity change [m/s] by the control law beside its impulse.

    The law gets as much of the along-track deviation as the thruster can follow from the look attitude `q_look`.
    """
    state, gains = memory.mission, memory.phase_gains
    gain = of_phase(state.phase, [periodic_lqr_gain.gain_at(each, predicted.burn_orbit) for each in gains])
    goal = phase_goal.goal_at_burn(software, state, predicted, time, period)
    deviation = predicted.burn_state_H - jnp.concatenate([goal.position, goal.arrival_velocity])
    wanted_N = apply_transposed(predicted.R_CN, goal.impulse + formation_law.lqr_feedback(gain, deviation))
    limit = burn_schedule.largest_delta_v(software.guidance, wanted_N, q_look)
    governed = reference_governor.govern(gain, deviation, goal.impulse, limit)
    command_H = software.stages.call(
        "formation_law", memory.own, gain=gain, deviation=governed, estimate=memory.orbit, time=time
    )
    return goal, command_H
