"""Goal of the present phase: what its reference asks of the next burn."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced
from rpojax.core.pytree import pytree, replace
from rpojax.flight.decisions.motion_prediction import Prediction
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import target_frame
from rpojax.flight.guidance.references import impulsive_tracking, reference_motion
from rpojax.flight.guidance.references.hold import Hold
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit
from rpojax.flight.guidance.target_frame import TargetFrame
from rpojax.flight.mission import team_mission_state
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.mission.phase_table import of_phase
from rpojax.flight.mission.static_mission_settings import PhaseSettings

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class Goal:
    """Desired motion at a burn.

    Attributes:
        position: (3,) at the burn [m]
        arrival_velocity: (3,) just before it [m/s]
        impulse: (3,) feed-forward velocity change [m/s]
    """

    position: Array
    arrival_velocity: Array
    impulse: Array


def planned_phase(reference: Any) -> Scalar:
    """Phase of a relative orbit [rad], 0 of another reference."""
    return reference.radial_phase if isinstance(reference, RelativeOrbit) else jnp.zeros(())


def planned_orbit(reference: Any) -> Float[Array, "3"]:
    """Amplitudes of a relative orbit [m], radial and across, and phase of the latter less the former [rad]; else 0."""
    if not isinstance(reference, RelativeOrbit):
        return jnp.zeros(3)
    lead = reference.cross_track_phase - reference.radial_phase
    return jnp.stack([reference.radial, reference.cross_track, lead])


def _shifted(reference: Any, state: MissionState, time: Scalar) -> Any:
    """The reference as it is at `time` [s]: in a team a relative orbit may be ahead of its plan."""
    if state.team is None or state.team.shift is None or not isinstance(reference, RelativeOrbit):
        return reference
    ahead = team_mission_state.angle(state.team, time)
    return replace(
        reference,
        radial_phase=reference.radial_phase + ahead,
        cross_track_phase=reference.cross_track_phase + ahead,
    )


def references(software: FlightSoftware, entry: PhaseEntry) -> list[tuple[str, Any]]:
    """Name and reference of all rows; holding and aborted, a servicer keeps to the place where that began."""
    place = Hold(position=entry.relative_state[:3])
    named = [(phase.name, reference_of(software, phase)) for phase in software.mission.phases]
    return [*named, *((name, place) for name in software.mission.built_in)]


def reference_of(software: FlightSoftware, phase: PhaseSettings) -> Any:
    """Record of the reference of a phase."""
    return software.params.mission.phases[phase.name].trajectory(software.params.formation)


def with_station(software: FlightSoftware, position: Vector) -> FlightSoftware:
    """Flight software of a formation with another desired position [m]."""
    params = software.params
    formation = replace(params.formation, desired_position=position)
    return dataclasses.replace(software, params=replace(params, formation=formation))


def desired_state(
    software: FlightSoftware, state: MissionState, orbit: TargetOrbit, frame: TargetFrame | None, time: Scalar
) -> Float[Array, "6"]:
    """Relative state in H (6,) of the present phase's reference at `time` [m, m/s], with the target at `orbit`.

    `frame` is that of the target then, in which some phases have theirs; None where it is not known.
    """
    elapsed = time - state.starts_at
    states = [
        software.stages.call(
            "reference",
            phase=name,
            reference=_shifted(reference, state, time),
            entry=state.entry,
            orbit=orbit,
            elapsed=elapsed,
        )
        for name, reference in references(software, state.entry)
    ]
    settings = software.mission
    if frame is not None and any(settings.in_target_frame):
        states = [
            target_frame.to_hill(frame, each) if turns else each
            for each, turns in zip(states, settings.in_target_frame, strict=True)
        ]
    return of_phase(state.phase, states)


def end_position(software: FlightSoftware, state: MissionState, orbit: TargetOrbit, time: Scalar) -> Vector:
    """Position [m] in the phase's frame at which its reference ends, or that at `time` [s] of one without an end.

    A phase that no condition ends has that of its entry.
    """
    settings, entry, elapsed = software.mission, state.entry, time - state.starts_at
    ends = [
        reference_motion.end_position(_shifted(reference_of(software, phase), state, time), entry, orbit, elapsed)
        if phase.ends
        else entry.relative_state[:3]
        for phase in settings.phases
    ]
    return of_phase(jnp.minimum(state.phase, settings.hold), [*ends, entry.relative_state[:3]])


def goal_at_burn(
    software: FlightSoftware, state: MissionState, predicted: Prediction, time: Scalar, period: Scalar
) -> Goal:
    """Goal of a burn that is decided at `time` [s] in a phase with a `period` [s] between its burns.

    The first burn of a phase changes to the velocity of its reference at once.
    """
    orbit, burn_time = predicted.burn_orbit, time + software.params.formation.lead

    def place(_: None, dt: Scalar) -> tuple[None, tuple[TargetOrbit, Vector]]:
        then = advanced(orbit, dt)
        return None, (then, desired_state(software, state, then, predicted.target_frame, burn_time + dt)[:3])

    # A scan: three copies of all references would take three times as long to compile.
    times = jnp.stack([-period, jnp.zeros_like(period), period])
    _, (orbits, positions) = jax.lax.scan(place, None, times)
    tracked = impulsive_tracking.tracked_point(orbits, period, positions)
    departure = tracked.arrival_velocity + tracked.impulse
    is_first = time - state.entered_at < 0.5 * period
    arrival = jnp.where(is_first, predicted.burn_state_H[3:], tracked.arrival_velocity)
    return Goal(position=positions[1], arrival_velocity=arrival, impulse=departure - arrival)
