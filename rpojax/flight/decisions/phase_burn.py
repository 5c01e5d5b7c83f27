"""Burn of a mission's phase: planned by the control law, then made safe or replaced by an abort burn."""

from functools import partial

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import apply_transposed
from rpojax.flight.control import formation_law, periodic_lqr_gain, reference_governor
from rpojax.flight.decisions import burn_decision, phase_goal
from rpojax.flight.decisions.mission_decision import is_passively_safe, keep_out_zone
from rpojax.flight.decisions.motion_prediction import Prediction
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import burn_planning
from rpojax.flight.guidance.burn_planning import BurnPlan
from rpojax.flight.guidance.target_pointing import TargetPointing
from rpojax.flight.mission import abort_burn, drift_clearance, safe_burn, team_mission
from rpojax.flight.mission.drift_clearance import Drift
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.mission.phase_settings import MissionSettings
from rpojax.flight.mission.phase_table import MissionTuning, constant_of_phase, of_phase
from rpojax.flight.mission.safe_burn import SafeBurn
from rpojax.flight.mission.team_mission import TeamMission
from rpojax.flight.navigation import burn_execution_error
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
    horizon; else another one is made. After an abort there is one burn, if that is needed, and another one only for
    what was measured since. Returned beside the burn is the state of the mission with its records of these decisions.
    """
    settings, tuning = phase_goal.mission_of(software)
    params, team, time = software.params, decision.team, decision.time
    if team is not None and settings.phasing != "fixed":
        shifted = _with_phase_of_team(software, decision, team)
        decision = replace(decision, memory=replace(decision.memory, mission=shifted))
    memory, predicted, pointing = decision.memory, decision.predicted, decision.pointing
    state = _mission_state(decision)
    period = _period(settings, state, software.tick_s)
    planned_H = _planned_delta_v(software, decision, period)
    aborted = state.phase == settings.aborted
    works = burn_decision.thruster_works(params, memory, time)
    uncertain = predicted.range_ratio_sigma >= params.formation.range_uncertainty_limit
    sees = pointing.visible & ~burn_decision.is_lost(params, memory) & memory.health.confident & ~uncertain
    keeps = ~aborted & sees
    was_made = _is_made(params, memory, time)
    after_abort = abort_burn.permission(state.abort_burns, aborted, works, sees, was_made)
    passive = is_passively_safe(settings, state)
    drift = _drift_after_burn(settings, tuning, state, predicted, passive, period)
    greatest = burn_planning.certain_delta_v(software.guidance)
    planned_H = _within_limit(software, predicted, pointing, jnp.where(keeps, planned_H, 0.0))
    may_wait = passive & ~after_abort.of_abort
    can_burn = (keeps & works) | after_abort.of_abort | after_abort.of_sight
    decided = state.team
    if team is None or decided is None or not settings.keeps_clear:
        safe_H = safe_burn.safe_delta_v(drift, planned_H, greatest, may_wait)
    else:
        others = _others(software, decision, drift, team)
        burn = safe_burn.safe_delta_v_among(drift, others, planned_H, greatest, may_wait)
        safe_H, decided = burn.delta_v_H, _decided(decided, burn, team, can_burn, time)
    delta_v_N = apply_transposed(predicted.R_CN, safe_H)
    plan = burn_planning.schedule_burn(software.guidance, delta_v_N, pointing.q_BN, can_burn, time)
    burns = abort_burn.recorded(state.abort_burns, after_abort, plan.cutoff > plan.ignition, was_made)
    return plan, replace(state, team=decided, abort_burns=burns)


def _mission_state(decision: Decision) -> MissionState:
    """State of the mission, which a burn of a phase has."""
    assert decision.memory.mission is not None
    return decision.memory.mission


def is_due(settings: MissionSettings, state: MissionState, time: Scalar, tick_s: float) -> Flag:
    """Whether `time` [s] is one of the times at which the present phase decides about burns."""
    period = _period(settings, state, tick_s)
    since = time - state.entered_at
    return jnp.abs(since - period * jnp.round(since / period)) < 0.5 * tick_s


def _period(settings: MissionSettings, state: MissionState, tick_s: float) -> Scalar:
    """Time between decisions about burns in the present phase [s]."""
    return constant_of_phase(state.phase, settings.control_ticks) * tick_s


def _within_limit(
    software: FlightSoftware, predicted: Prediction, pointing: TargetPointing, planned_H: Vector
) -> Vector:
    """A planned velocity change [m/s] as the look-away limit shortens it: so it is judged."""
    planned_N = apply_transposed(predicted.R_CN, planned_H)
    share = burn_planning.share_within_limit(software.guidance, planned_N, pointing.q_BN)
    return planned_H * share


def _is_made(params: FlightParams, memory: FlightMemory, time: Scalar) -> Flag:
    """Whether the latest planned burn gave its velocity change, or may still give it after `time` [s]."""
    plan, vehicle = memory.plan, params.vehicle
    given = (jnp.minimum(plan.cutoff, time) - jnp.minimum(plan.ignition, time)) * vehicle.thrust / vehicle.mass
    has_failed = memory.thruster_failed_at >= plan.ignition
    return abort_burn.is_made(plan.delta_v_N, given, time >= plan.cutoff, has_failed)


def _with_phase_of_team(software: FlightSoftware, decision: Decision, team: Team) -> MissionState:
    """State of the mission with the phase of the relative orbit that the team wants."""
    settings, tuning = phase_goal.mission_of(software)
    state, predicted, time = _mission_state(decision), decision.predicted, decision.time
    assert state.team is not None
    assert state.team.shift is not None
    before = state.team.shift
    running = state.phase < settings.hold
    row = jnp.minimum(state.phase, settings.hold - 1)
    planned = [phase_goal.planned_orbit(tuning.phases[phase.name].reference) for phase in settings.phases]
    situation = team_knowledge.situation(
        team.tuning,
        team.peers,
        team_knowledge.Own(
            estimate=decision.memory.orbit,
            orbit=predicted.orbit,
            state_H=predicted.state_H,
            follows=running,
            shift=before.wanted,
            shift_left=before.wanted - team_mission.angle(state.team, time),
            present=before.present,
            slots=of_phase(row, [team.peers.slots[number] for number in range(len(settings.phases))]),
            planned=of_phase(row, planned),
            clearance=team.tuning.keep_out + tuning.abort_margin,
            sun_N=decision.pointing.sun_N,
        ),
        time,
    )
    own = decision.memory.own
    wanted = software.stages.call("team_phasing", own, settings=settings, tuning=team.tuning, team=situation)
    return replace(state, team=team_mission.shifted(state.team, wanted, situation.present, time))


def _others(software: FlightSoftware, decision: Decision, drift: Drift, team: Team) -> safe_burn.Clearance:
    """Clearance of the free motion after a burn, like the `drift`, from those of the others in the team."""
    _, tuning = phase_goal.mission_of(software)
    navigation = software.params.navigation
    state_H, covariance_H = peer_drift.relative_motion(
        decision.memory.orbit,
        team.peers,
        NextBurn(
            orbit=decision.predicted.burn_orbit,
            R_CN=decision.predicted.R_CN,
            time=decision.time,
            lead=software.params.formation.lead,
        ),
        jnp.hypot(burn_execution_error.new_sigma(navigation), navigation.burn_direction_sigma),
    )
    drifts = PeerDrifts(
        state_H=state_H,
        covariance_H=covariance_H,
        orbit=drift.orbit,
        sigmas=drift.sigmas,
        radius=team.tuning.keep_out + tuning.abort_margin,
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
    settings: MissionSettings,
    tuning: MissionTuning,
    state: MissionState,
    predicted: Prediction,
    is_passive: Flag,
    period: Scalar,
) -> Drift:
    """Free motion after a burn of the present phase, passively safe or not, and what it must keep clear of."""
    orbit_period = drift_clearance.orbit_period(predicted.burn_orbit)
    span = jnp.where(is_passive, jnp.minimum(orbit_period, tuning.abort_horizon), 2.0 * period)
    return Drift(
        orbit=predicted.burn_orbit,
        state_H=predicted.burn_state_H,
        scale_sigma=predicted.range_ratio_sigma,
        covariance_H=predicted.burn_covariance_H,
        sigmas=tuning.abort_sigmas,
        semi_axes=keep_out_zone(settings, tuning, state) + tuning.abort_margin,
        first_span=span,
        horizon=jnp.where(is_passive, jnp.maximum(span, tuning.abort_horizon), span),
    )


def _planned_delta_v(software: FlightSoftware, decision: Decision, period: Scalar) -> Vector:
    """Velocity change (3,) in H [m/s] by the control law for the reference of the present phase."""
    memory, predicted = decision.memory, decision.predicted
    state = _mission_state(decision)
    assert memory.phase_gains is not None
    gain = of_phase(
        state.phase, [periodic_lqr_gain.gain_at(gains, predicted.burn_orbit) for gains in memory.phase_gains]
    )
    goal = phase_goal.goal_at_burn(software, state, predicted, decision.time, period)
    deviation = predicted.burn_state_H - jnp.concatenate([goal.position, goal.arrival_velocity])
    wanted_N = apply_transposed(predicted.R_CN, goal.impulse + formation_law.lqr_feedback(gain, deviation))
    limit = burn_planning.largest_delta_v(software.guidance, wanted_N, decision.pointing.q_BN)
    governed = reference_governor.govern(gain, deviation, goal.impulse, limit)
    command_H = software.stages.call(
        "formation_law", memory.own, gain=gain, deviation=governed, estimate=memory.orbit, time=decision.time
    )
    return goal.impulse + command_H
