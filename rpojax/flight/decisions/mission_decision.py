"""Decisions of a mission with phases: the present phase, and the gains, attitude and keep-out zone that it has."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.control import periodic_lqr_gain
from rpojax.flight.control.formation_law import lqr_gain
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.decisions import burn_conditions, phase_goal, translation
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import other_pointing as attitudes
from rpojax.flight.guidance import target_frame
from rpojax.flight.guidance.other_pointing import OtherPointing
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.guidance.target_frame import TargetFrame
from rpojax.flight.mission import drift_clearance, mission_state, team_mission_state
from rpojax.flight.mission.drift_clearance import Drift
from rpojax.flight.mission.mission_manager import Situation
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.mission.phase_table import constant_of_phase, of_phase
from rpojax.flight.mission.static_mission_settings import MissionSettings
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]


@pytree
class TeamStart:
    """How the mission of a servicer of a team starts.

    Attributes:
        first_decision: () when its first phase begins [s]
        phase_rate: () of the shift of relative orbits where their phases are chosen on the way [rad/s]
    """

    first_decision: Array
    phase_rate: Array


def initial_state(software: FlightSoftware, estimate: OrbitEstimate, team: TeamStart | None) -> MissionState:
    """State of the mission at the start of a run; alone, its first phase begins at once."""
    settings, params = software.mission, software.params
    first_decision = None if team is None else team.first_decision
    predicted = predict_to_burn(params, estimate, first_decision)
    entry = PhaseEntry(relative_state=predicted.burn_state_H, orbit=predicted.burn_orbit)
    state = mission_state.initial(entry, params.formation.lead, first_decision)
    if team is None or not settings.coordinated:
        return state
    rate = None if settings.phasing == "fixed" else team.phase_rate
    return replace(state, team=team_mission_state.initial(state.entered_at, rate, settings.servicers))


def phase_gains(software: FlightSoftware, estimate: OrbitEstimate) -> tuple[Float[Array, "places 3 6"], ...]:
    """LQR gains over the orbit by row of the phase table; held places have the formation's period."""
    settings, params = software.mission, software.params
    relative, servicer = estimate.relative, estimate.servicer
    orbit = yamanaka_ankersen.target_orbit(servicer.r_SN_N + relative.r_TS_N, servicer.v_SN_N + relative.v_TS_N)

    def over_orbit(weights: FormationTuning, burns: int, tables: int, period: float) -> Float[Array, "places 3 6"]:
        if burns == 1:
            return lqr_gain(weights, mean_motion(orbit.semi_major_axis), period)[None]
        return periodic_lqr_gain.periodic_lqr_gains(weights, orbit, burns, tables)

    gains = []
    for static in settings.phases:
        weights = params.mission.phases[static.name].weights(params.formation)
        gains.append(
            over_orbit(weights, static.burns_per_orbit, static.gain_tables, static.control_ticks * software.tick_s)
        )
    if settings.is_managed:
        hold_period = settings.hold_ticks * software.tick_s
        held = over_orbit(params.formation, settings.hold_burns_per_orbit, settings.hold_gain_tables, hold_period)
        gains += [held for _ in settings.built_in]
    return tuple(gains)


def manage_mission(software: FlightSoftware, memory: FlightMemory, time: Scalar) -> MissionState:
    """State of the mission after a decision at `time` [s]."""
    settings, params, state = software.mission, software.params, memory.mission
    tuning, predicted = params.mission, predict_to_burn(params, memory.orbit)
    lead = params.formation.lead
    # An abort that is decided at the next decision burns its `lead` later.
    soon = 2.0 * lead
    drift = Drift(
        orbit=predicted.orbit,
        state_H=predicted.state_H,
        scale_sigma=predicted.range_ratio_sigma,
        covariance_H=predicted.covariance_H,
        sigmas=tuning.abort_sigmas,
        semi_axes=keep_out_zone(software, state),
        first_span=soon,
        horizon=soon,
    )
    none = jnp.zeros_like(predicted.state_H[:3, None])
    near = _NEAR_BEFORE_ABORT if any(settings.translates) else 0
    clearance, by_estimate = drift_clearance.least_clearance(drift, none, none[:1], _SAMPLES_BEFORE_ABORT, near)
    # As for its burns: on a passively safe orbit to know more is better than to leave it by an uncertain estimate.
    is_passive = is_passively_safe(settings, state)
    least = jnp.where(is_passive, by_estimate[0, 0], clearance[0, 0])
    state_T, place, can_follow = None, predicted.state_H[:3], jnp.ones((), dtype=bool)
    if predicted.target_frame is not None and any(settings.in_target_frame):
        state_T = target_frame.from_hill(predicted.target_frame, predicted.state_H)
        can_follow = _can_follow(params, memory, predicted.target_frame)
        place = jnp.where(constant_of_phase(state.phase, settings.in_target_frame), state_T[:3], place)
    situation = Situation(
        time=time,
        state_H=predicted.state_H,
        burn_time=time + lead,
        burn_state_H=predicted.burn_state_H,
        burn_orbit=predicted.burn_orbit,
        burn_pending=(memory.plan.cutoff > memory.plan.ignition) & (memory.plan.cutoff > time),
        place=place,
        end=phase_goal.end_position(software, state, predicted.orbit, time),
        state_T=state_T,
        attitude_sigma=memory.orbit.relative.attitude_sigma,
        can_follow=can_follow,
        may_follow=translation.may_follow(software, memory),
        range_sigma=predicted.range_ratio_sigma * gradient_safe.norm(predicted.state_H[:3]),
        seen=memory.pointing.acquisition.acquired,
        lost=_is_lost(params, memory),
        confident=memory.health.confident,
        thruster_works=burn_conditions.thruster_works(params, memory, time),
        enters_keep_out=least < 1.0,
    )
    return software.stages.call(
        "mission_manager", memory.own, settings=settings, tuning=tuning, state=state, situation=situation
    )


def _can_follow(params: FlightParams, memory: FlightMemory, frame: TargetFrame) -> Flag:
    """Whether the thrusters could follow the turning target at the present range."""
    assert params.thrusters is not None
    distance = gradient_safe.norm(memory.orbit.relative.r_TS_N)
    return target_frame.can_be_followed(frame, params.thrusters.authority, params.vehicle.mass, distance)


_SAMPLES_BEFORE_ABORT = 6
"""Times in the two minutes in which an abort cannot act yet: one in 20 s, in which a servicer at 0.1 m/s goes 2 m, as
far as the packaged `mission.abort_margin_m`."""


_NEAR_BEFORE_ABORT = 2
"""Times in the first and the last of these intervals of a servicer that comes within metres of its zone."""


def _is_lost(params: FlightParams, memory: FlightMemory) -> Flag:
    """True if the target has stayed unseen for too long while it should have been visible.

    A burn is not based on a target that has been out of sight for some seconds. An abort waits: at the edge of light
    the camera may see nothing before the estimate says so, and burns keep the motion safe for two control periods.
    """
    return memory.pointing.acquisition.unseen_time > params.health.unseen_limit


def other_pointing(software: FlightSoftware, memory: FlightMemory, sun_N: Vector) -> OtherPointing | None:
    """Attitude of a phase that does not point at the target, with the Sun at `sun_N` [m]; None if all phases do."""
    settings, vehicle = software.mission, software.params.vehicle
    modes = [*(phase.pointing for phase in settings.phases), *("target" for _ in settings.built_in)]
    if set(modes) == {"target"}:
        return None
    phase = memory.mission.phase
    safe = attitudes.sun_safe_attitude(vehicle, memory.orbit, sun_N)
    ahead = attitudes.velocity_attitude(vehicle, memory.orbit)
    is_ahead = constant_of_phase(phase, [mode == "velocity" for mode in modes])
    q_BN, omega = select(is_ahead, ahead, safe)
    is_wanted = constant_of_phase(phase, [mode != "target" for mode in modes])
    return OtherPointing(q_BN=q_BN, omega_BN_B=omega, is_wanted=is_wanted)


def keep_out_zone(software: FlightSoftware, state: MissionState) -> Vector:
    """Semi-axes [m] of the keep-out ellipsoid of the present phase."""
    settings, tuning = software.mission, software.params.mission
    phases = [tuning.phases[phase.name].keep_out for phase in settings.phases]
    return of_phase(state.phase, [*phases, *(tuning.keep_out for _ in settings.built_in)])


def is_passively_safe(settings: MissionSettings, state: MissionState) -> Flag:
    """Whether the present phase is passively safe; a hold is not, the drift after an abort is."""
    return constant_of_phase(state.phase, [*(phase.passively_safe for phase in settings.phases), False, True])
