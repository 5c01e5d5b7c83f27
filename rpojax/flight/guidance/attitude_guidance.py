"""Attitude guidance: target tracking, turns to and from burns, and the search for a lost target.

The pointing schedule follows Figure 5 of the re-implemented paper; its times come from the slew that the wheels can do.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.flight.guidance import search_spiral, slew_profile, target_acquisition
from rpojax.flight.guidance.burn_planning import BurnPlan
from rpojax.flight.guidance.other_pointing import OtherPointing
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.flight.guidance.target_pointing import look_attitude
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@pytree
class PointingState:
    """Memory of the attitude guidance.

    Attributes:
        reference: attitude reference
        burn_attitude_commanded: () bool, the end attitude is the burn's
        acquired: () bool, the target has been acquired since it last came into the light
        recent_detections: () evidence of accepted boxes, fading while the target should be seen and is not [s]
        unseen_time: () since the last accepted box, planned look-aways and darkness left out [s]
        search_time: () along the search spiral; 0 when not searching [s]
        search_failed: () bool, all directions of the uncertainty have been searched in this tick without success
    """

    reference: SlewReference
    burn_attitude_commanded: Array
    acquired: Array
    recent_detections: Array
    unseen_time: Array
    search_time: Array
    search_failed: Array


def initial_pointing(vehicle: VehicleModel, estimate: OrbitEstimate) -> PointingState:
    """Pointing state with the camera on the estimated target and no slew under way."""
    q_EN, omega = look_attitude(vehicle, estimate)
    zero = jnp.zeros((), dtype=q_EN.dtype)
    reference = SlewReference(
        q_EN=q_EN, omega_EN_E=omega, remainder=jnp.zeros_like(omega), slew_age=zero, slew_time=jnp.ones_like(zero)
    )
    never = jnp.zeros((), dtype=bool)
    return PointingState(
        reference=reference,
        burn_attitude_commanded=never,
        acquired=never,
        recent_detections=zero,
        unseen_time=zero,
        search_time=zero,
        search_failed=never,
    )


def is_lost(pointing: PointingTuning, state: PointingState) -> Flag:
    """True while the target is not acquired, or has not been seen for too long."""
    return (
        (state.unseen_time > pointing.search_after)
        | ~state.acquired
        | (state.recent_detections < target_acquisition.LOSS_EVIDENCE)
    )


def guide(
    pointing: PointingTuning,
    vehicle: VehicleModel,
    estimate: OrbitEstimate,
    plan: BurnPlan,
    state: PointingState,
    box_accepted: Flag,
    visible: Flag,
    time: Scalar,
    dt: float,
    other: OtherPointing | None = None,
) -> tuple[PointingState, Array]:
    """Pointing state with the reference for the next `dt` [s], and the pointing mode.

    In the dark (not `visible`) there is no search, nor while an `other` attitude is wanted.
    """
    visible = visible | box_accepted
    if other is not None:
        visible = visible & ~other.is_wanted
    to_burn = (time >= plan.turn_start - _TIME_TOLERANCE) & (time < plan.cutoff)
    looking_away = to_burn | (state.burn_attitude_commanded | _is_slewing_back(state)) & ~box_accepted
    acquisition = target_acquisition.update_acquisition(
        pointing,
        state.recent_detections,
        state.acquired,
        state.unseen_time,
        box_accepted,
        visible,
        looking_away,
        dt,
    )
    searching = (acquisition.unseen_time > acquisition.wait) & ~to_burn
    pace = search_spiral.spiral_pace(dt)
    # A restarted spiral waits for the slew to its middle, or nobody would look there.
    advance = jnp.where((state.search_time > 0.0) & _is_slewing_back(state), 0.0, pace * dt)
    duration = search_spiral.spiral_duration(pointing, estimate)
    ends = searching & (state.search_time + advance > duration)
    search_time = jnp.where(searching, jnp.where(ends, 1.0, state.search_time + advance), 0.0)

    q_target, omega_target = _target_attitude(
        pointing, vehicle, estimate, state.reference.q_EN, searching, search_time, pace, time
    )
    if other is not None:
        q_target = jnp.where(other.is_wanted, other.q_BN, q_target)
        omega_target = jnp.where(other.is_wanted, other.omega_BN_B, omega_target)
    q_end = jnp.where(to_burn, plan.q_burn, q_target)
    omega_end = jnp.where(to_burn, 0.0, omega_target)
    changed = to_burn != state.burn_attitude_commanded
    reference = slew_profile.retarget(pointing, state.reference, q_end, omega_end, changed, dt)
    after = PointingState(
        reference=reference,
        burn_attitude_commanded=to_burn,
        acquired=acquisition.acquired,
        recent_detections=acquisition.recent_detections,
        unseen_time=acquisition.unseen_time,
        search_time=search_time,
        search_failed=ends & search_spiral.covers_uncertainty(pointing, estimate),
    )
    return after, _pointing_mode(pointing, plan, reference, to_burn, searching, time)


_TIME_TOLERANCE = 1e-6
"""Rounding must not delay by a tick the turn to a burn of the longest duration, which begins on a whole tick [s]."""


def _is_slewing_back(state: PointingState) -> Flag:
    """True during a slew to the target."""
    return ~state.burn_attitude_commanded & (state.reference.slew_age < state.reference.slew_time)


def _target_attitude(
    pointing: PointingTuning,
    vehicle: VehicleModel,
    estimate: OrbitEstimate,
    q_before: Float[Array, "4"],
    searching: Flag,
    search_time: Scalar,
    pace: float,
    time: Scalar,
) -> tuple[Float[Array, "4"], Vector]:
    """Attitude `q_BN` towards the estimated target, or on the search spiral around it, and its rate [rad/s] in B."""
    # They would be repeated in each component of the attitude.
    (q_look, omega_look), (offset_K, rate_K) = fusion_barrier(
        (look_attitude(vehicle, estimate, q_before), search_spiral.spiral_offset(pointing, search_time)), time
    )
    q_BK = quaternion.conjugate(quaternion.normalize(vehicle.camera_mounting))
    q_search = quaternion.exp(-rotate(q_BK, offset_K))
    omega_search = rotate(q_search, omega_look) + rotate(q_BK, pace * rate_K)
    q_target = jnp.where(searching, quaternion.multiply(q_search, q_look), q_look)
    return q_target, jnp.where(searching, omega_search, omega_look)


def _pointing_mode(
    pointing: PointingTuning, plan: BurnPlan, reference: SlewReference, to_burn: Flag, searching: Flag, time: Scalar
) -> Array:
    """Pointing mode at `time` [s] from the start of the run."""
    slewing = reference.slew_age < reference.slew_time
    away_mode = jnp.where(time >= plan.ignition, Mode.BURN, Mode.TURN)
    # An inhibited burn is followed by a turn back, too.
    after_burn = (plan.cutoff > plan.turn_start) & (time < plan.cutoff + pointing.look_away_limit)
    back_mode = jnp.where(after_burn, Mode.TURN_BACK, Mode.SEARCH)
    tracking_mode = jnp.where(searching, Mode.SEARCH, jnp.where(slewing, back_mode, Mode.LOOK))
    return jnp.where(to_burn, away_mode, tracking_mode)
