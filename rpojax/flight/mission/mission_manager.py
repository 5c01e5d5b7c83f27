"""Mission manager: the automaton that moves a mission from phase to phase, holds it or aborts it.

It knows what is known on board alone. A burn that is decided is finished before the phase changes, unless by an abort.
An end of a phase comes before its timeout, a command to hold before both, and an abort before all. The last phase does
not end; after an abort there is no other phase.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.mission.mission_state import AbortReason, Condition, MissionState, Transition
from rpojax.flight.mission.phase_table import Corridor, MissionTuning, Until, constant_of_phase, of_phase
from rpojax.flight.mission.static_mission_settings import MissionSettings

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]


@pytree
class Situation:
    """What the flight software knows at a decision.

    Attributes:
        time: () since the start of the run [s]
        state_H: (6,) estimated relative position and velocity [m, m/s]
        burn_time: () middle of a burn that is decided now [s]
        burn_state_H: (6,) relative state predicted to then [m, m/s]
        burn_orbit: of the target then
        burn_pending: () bool, whether a decided burn is still to be finished
        place: (3,) estimated position in the frame of the present phase [m]
        end: (3,) end of its reference there [m]
        state_T: (6,) relative state in the target's frame [m, m/s], None where no phase is in it
        attitude_sigma: () 1-sigma of the attitude of the target about the least known axis of T [rad], else infinite
        may_follow: () bool, whether the estimate is good enough to follow the reference of the present phase by it
        can_follow: () bool, whether the thrusters could follow the turning target at the present range
        range_sigma: () 1-sigma of the range [m]
        seen: () bool, whether the target is acquired
        lost: () bool, whether it has been out of sight for too long
        confident: () bool, whether the orbit filter passes its tests
        thruster_works: () bool
        enters_keep_out: () bool, whether the servicer may drift into the keep-out zone before an abort could prevent
            it; in a passively safe phase whether it does so by the estimate alone
    """

    time: Array
    state_H: Array
    burn_time: Array
    burn_state_H: Array
    burn_orbit: TargetOrbit
    burn_pending: Array
    place: Array
    end: Array
    state_T: Array | None
    attitude_sigma: Array
    can_follow: Array
    may_follow: Array
    range_sigma: Array
    seen: Array
    lost: Array
    confident: Array
    thruster_works: Array
    enters_keep_out: Array


def update(settings: MissionSettings, tuning: MissionTuning, state: MissionState, situation: Situation) -> MissionState:
    """State of the mission after a decision."""
    phases = [tuning.phases[each.name] for each in settings.phases]
    running = state.phase < settings.hold
    idle = ~situation.burn_pending
    row = jnp.minimum(state.phase, settings.hold - 1)
    until = of_phase(row, [phase.until for phase in phases])
    arrived_at = _since(_is_inside(until, situation), state.arrived_at, situation.time)
    known_at = _since(situation.range_sigma < until.range_sigma, state.known_at, situation.time)
    elapsed = situation.time - state.entered_at
    attitude_known = situation.attitude_sigma < until.attitude_sigma
    attitude_known &= situation.can_follow | ~constant_of_phase(row, settings.before_target_frame)
    attitude_known_at = _since(attitude_known, state.attitude_known_at, situation.time)
    now = replace(state, arrived_at=arrived_at, known_at=known_at, attitude_known_at=attitude_known_at)
    ended = (
        running
        & idle
        & constant_of_phase(row, [phase.ends for phase in settings.phases])
        & (unmet_conditions(until, now, situation.time) == 0)
    )
    timed_out = running & idle & ~ended & (elapsed >= of_phase(row, [phase.timeout for phase in phases]))
    after_timeout, aborts_on_timeout = _timeout_rows(settings, row)
    following = jnp.minimum(state.phase + 1, settings.hold - 1)
    phase = jnp.where(ended, following, jnp.where(timed_out, after_timeout, state.phase))
    by = jnp.where(ended, int(Transition.CONDITIONS_MET), int(Transition.TIMEOUT))
    held = (situation.time >= tuning.hold_at) & (situation.time < tuning.resume_at) & running & idle
    phase, by = jnp.where(held, settings.hold, phase), jnp.where(held, int(Transition.HOLD_COMMAND), by)
    resumed = (state.phase == settings.hold) & (state.entered_at < tuning.resume_at)
    resumed &= idle & (situation.time >= tuning.resume_at)
    phase, by = jnp.where(resumed, state.held_phase, phase), jnp.where(resumed, int(Transition.RESUME_COMMAND), by)
    reason = _abort_reason(settings, tuning, state, situation, timed_out & aborts_on_timeout)
    aborts = (reason != AbortReason.NONE) & (state.phase != settings.aborted)
    phase = jnp.where(aborts | (state.phase == settings.aborted), settings.aborted, phase).astype(jnp.int32)
    begins = phase != state.phase
    by = jnp.where(aborts, int(Transition.ABORT), by)
    starts_at, entry = _entry(settings, phase, situation)
    return MissionState(
        phase=phase,
        held_phase=jnp.where(running & (phase == settings.hold), state.phase, state.held_phase),
        entered_at=jnp.where(begins, situation.time, state.entered_at),
        entered_by=jnp.where(begins, by, state.entered_by).astype(jnp.int32),
        starts_at=jnp.where(begins, starts_at, state.starts_at),
        entry=select(begins, entry, state.entry),
        arrived_at=jnp.where(begins, jnp.inf, arrived_at),
        known_at=jnp.where(begins, jnp.inf, known_at),
        attitude_known_at=jnp.where(begins, jnp.inf, attitude_known_at),
        has_seen_target=state.has_seen_target | situation.seen,
        abort_reason=jnp.where(aborts, reason, state.abort_reason).astype(jnp.int32),
        abort_burns=state.abort_burns,
        team=state.team,
    )


def _entry(settings: MissionSettings, phase: Int[Array, ""], situation: Situation) -> tuple[Scalar, PhaseEntry]:
    """When the reference of a phase that begins now starts [s], and from where: with its first burn, or at once."""
    time, state = situation.burn_time, situation.burn_state_H
    if situation.state_T is not None:
        turns = constant_of_phase(phase, settings.in_target_frame)
        time, state = select(turns, (situation.time, situation.state_T), (time, state))
    return time, PhaseEntry(relative_state=state, orbit=situation.burn_orbit)


def unmet_conditions(until: Until, state: MissionState, time: Scalar) -> Int[Array, ""]:
    """Conditions of the present phase that do not hold at a time [s], as the bits of `Condition`.

    One that is not given holds from the begin of the phase on, before the first decision in it.
    """
    anywhere = jnp.all(jnp.isinf(until.arrival_box), axis=0)
    holds = (
        (Condition.TIME, time - state.entered_at >= until.time),
        (Condition.ARRIVAL, anywhere | (time - state.arrived_at >= until.arrival_for)),
        (Condition.RANGE_SIGMA, jnp.isinf(until.range_sigma) | (time - state.known_at >= until.range_sigma_for)),
        (Condition.GROUND_GO, time >= until.ground_go),
        (
            Condition.ATTITUDE_SIGMA,
            jnp.isinf(until.attitude_sigma) | (time - state.attitude_known_at >= until.attitude_sigma_for),
        ),
    )
    return sum((jnp.where(met, 0, int(condition)) for condition, met in holds), jnp.zeros((), dtype=jnp.int32))


def leaves_corridor(corridor: Corridor, place: Vector) -> Flag:
    """True for a position [m], in the axes of the corridor, outside of it."""
    axis = gradient_safe.normalize(corridor.axis)
    ahead = jnp.sum(axis * place, axis=0)
    aside = gradient_safe.norm(place - ahead * axis)
    return (ahead < 0.0) | (aside > corridor.width + ahead * jnp.tan(corridor.half_angle))


def _is_inside(until: Until, situation: Situation) -> Flag:
    """True in the arrival box."""
    return jnp.all(jnp.abs(situation.place - situation.end) <= until.arrival_box, axis=0)


def _since(holds: Flag, since: Scalar, time: Scalar) -> Scalar:
    """Time since which a condition has held [s], infinite if it does not."""
    return jnp.where(holds, jnp.minimum(since, time), jnp.inf)


def _timeout_rows(settings: MissionSettings, row: Int[Array, ""]) -> tuple[Array, Array]:
    """Phase after a timeout, and whether the timeout is a reason for an abort."""
    last = settings.hold - 1
    rows = {"next": None, "hold": settings.hold, "abort": settings.aborted}
    after = [
        min(number + 1, last) if rows[phase.on_timeout] is None else rows[phase.on_timeout]
        for number, phase in enumerate(settings.phases)
    ]
    aborts = [phase.on_timeout == "abort" for phase in settings.phases]
    return constant_of_phase(row, [int(each or 0) for each in after]), constant_of_phase(row, aborts)


def _abort_reason(
    settings: MissionSettings, tuning: MissionTuning, state: MissionState, situation: Situation, timed_out: Flag
) -> Int[Array, ""]:
    """The first reason for an abort, 0 without one.

    In a passively safe phase nothing but a command, a timeout, the threat of entering the keep-out zone or a corridor
    that was left is one: its free motion needs neither navigation nor thrust. The threat counts before the target has
    been seen, too.
    """
    running = state.phase < settings.hold
    row = jnp.minimum(state.phase, settings.hold - 1)
    forced = ~(running & constant_of_phase(row, [phase.passively_safe for phase in settings.phases]))
    outside = jnp.zeros((), dtype=bool)
    for number, phase in enumerate(settings.phases):
        if phase.has_corridor:
            corridor = tuning.phases[phase.name].corridor
            assert corridor is not None
            outside |= (state.phase == number) & leaves_corridor(corridor, situation.place)
    watched = forced & state.has_seen_target
    turns = running & constant_of_phase(row, [phase.in_target_frame for phase in settings.phases])
    reason = jnp.zeros((), dtype=jnp.int32)
    for applies, code in reversed(
        (
            (situation.time >= tuning.abort_at, AbortReason.COMMAND),
            (timed_out, AbortReason.TIMEOUT),
            (situation.enters_keep_out, AbortReason.KEEP_OUT_PREDICTED),
            (outside, AbortReason.CORRIDOR_LEFT),
            ((situation.lost & watched) | (turns & ~situation.may_follow), AbortReason.TARGET_LOST),
            (~situation.confident & watched, AbortReason.CONFIDENCE_LOST),
            (~situation.thruster_works & watched, AbortReason.THRUSTER_FAILED),
            (turns & jnp.isinf(situation.attitude_sigma), AbortReason.ATTITUDE_LOST),
        )
    ):
        reason = jnp.where(applies, int(code), reason)
    return reason
