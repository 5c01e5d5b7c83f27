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
from rpojax.flight.guidance.burn_schedule import BurnPlan
from rpojax.flight.guidance.other_pointing import OtherPointing
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.guidance.pointing_tuning import GuidanceSoftware, PointingTuning
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.flight.guidance.target_acquisition import Acquisition, Sighting
from rpojax.flight.guidance.target_pointing import look_attitude
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel
from rpojax.time_scales import TIME_ROUNDING_S

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@pytree
class PointingState:
    """Memory of the attitude guidance.

    Attributes:
        reference: attitude reference
        burn_attitude_commanded: () bool, the end attitude is the burn's
        acquisition: of the target
        search_time: () along the search spiral; 0 when not searching [s]
        search_failed: () bool, all directions of the uncertainty have been searched in this tick without success
    """

    reference: SlewReference
    burn_attitude_commanded: Array
    acquisition: Acquisition
    search_time: Array
    search_failed: Array


@pytree
class GuidanceTick:
    """What attitude guidance goes by in a tick.

    Attributes:
        time: () since the start of the run [s]
        estimate: of both orbits
        plan: latest decided burn
        sighting: what the frame shows of the target
        visible: () bool, the target may be visible; in the dark there is no search
        other: attitude in place of that towards the target, None where no phase may ask for one
    """

    time: Array
    estimate: OrbitEstimate
    plan: BurnPlan
    sighting: Sighting
    visible: Array
    other: OtherPointing | None = None


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
        acquisition=target_acquisition.never_seen(),
        search_time=zero,
        search_failed=never,
    )


def is_lost(pointing: PointingTuning, state: PointingState) -> Flag:
    """True while the target is not acquired, or has not been seen for too long."""
    acquisition = state.acquisition
    return (
        (acquisition.unseen_time > pointing.search_after)
        | ~acquisition.acquired
        | (acquisition.recent_detections < target_acquisition.LOSS_EVIDENCE)
    )


def guide(guidance: GuidanceSoftware, state: PointingState, tick: GuidanceTick) -> tuple[PointingState, Array]:
    """Pointing state with the reference up to the next tick, and the pointing mode."""
    pointing, plan, other = guidance.pointing, tick.plan, tick.other
    target_seen = tick.sighting.seen
    visible = tick.visible | target_seen
    if other is not None:
        visible = visible & ~other.is_wanted
    # Rounding must not delay by a tick the turn to a burn of the longest duration, which begins on a whole tick.
    to_burn = (tick.time >= plan.turn_start - TIME_ROUNDING_S) & (tick.time < plan.cutoff)
    looking_away = to_burn | (state.burn_attitude_commanded | _is_slewing_back(state)) & ~target_seen
    acquisition = target_acquisition.update_acquisition(
        guidance, state.acquisition, tick.sighting, visible, looking_away
    )
    wait = target_acquisition.search_wait(guidance, acquisition.acquired)
    searching = (acquisition.unseen_time > wait) & ~to_burn
    # A restarted spiral waits for the slew to its middle, or nobody would look there; and any waits where it may have
    # found the target.
    way = search_spiral.spiral_pace(guidance.tick_s) * guidance.tick_s
    waits = _is_slewing_back(state) | tick.sighting.promising
    advance = jnp.where((state.search_time > 0.0) & waits, 0.0, way)
    duration = search_spiral.spiral_duration(pointing, tick.estimate)
    ends = searching & (state.search_time + advance > duration)
    search_time = jnp.where(searching, jnp.where(ends, 1.0, state.search_time + advance), 0.0)

    q_target, omega_target = _target_attitude(guidance, tick, state.reference.q_EN, searching, search_time)
    if other is not None:
        q_target = jnp.where(other.is_wanted, other.q_BN, q_target)
        omega_target = jnp.where(other.is_wanted, other.omega_BN_B, omega_target)
    q_end = jnp.where(to_burn, plan.q_burn, q_target)
    omega_end = jnp.where(to_burn, 0.0, omega_target)
    changed = to_burn != state.burn_attitude_commanded
    reference = slew_profile.retarget(guidance, state.reference, q_end, omega_end, changed)
    after = PointingState(
        reference=reference,
        burn_attitude_commanded=to_burn,
        acquisition=acquisition,
        search_time=search_time,
        search_failed=ends & search_spiral.covers_uncertainty(pointing, tick.estimate),
    )
    return after, _pointing_mode(pointing, tick, reference, to_burn, searching)


def _is_slewing_back(state: PointingState) -> Flag:
    """True during a slew to the target."""
    return ~state.burn_attitude_commanded & (state.reference.slew_age < state.reference.slew_time)


def _target_attitude(
    guidance: GuidanceSoftware, tick: GuidanceTick, q_before: Float[Array, "4"], searching: Flag, search_time: Scalar
) -> tuple[Float[Array, "4"], Vector]:
    """Attitude `q_BN` towards the estimated target, or on the search spiral around it, and its rate [rad/s] in B."""
    # They would be repeated in each component of the attitude.
    (q_look, omega_look), (offset_K, rate_K) = fusion_barrier(
        (
            look_attitude(guidance.vehicle, tick.estimate, q_before),
            search_spiral.spiral_offset(guidance.pointing, search_time),
        ),
        tick.time,
    )
    q_BK = quaternion.conjugate(quaternion.normalize(guidance.vehicle.camera_mounting))
    q_search = quaternion.exp(-rotate(q_BK, offset_K))
    omega_search = rotate(q_search, omega_look) + rotate(q_BK, search_spiral.spiral_pace(guidance.tick_s) * rate_K)
    q_target = jnp.where(searching, quaternion.multiply(q_search, q_look), q_look)
    return q_target, jnp.where(searching, omega_search, omega_look)


def _pointing_mode(
    pointing: PointingTuning, tick: GuidanceTick, reference: SlewReference, to_burn: Flag, searching: Flag
) -> Array:
    """Pointing mode of the tick."""
    plan, time = tick.plan, tick.time
    slewing = reference.slew_age < reference.slew_time
    away_mode = jnp.where(time >= plan.ignition, Mode.BURN, Mode.TURN)
    # An inhibited burn is followed by a turn back, too.
    after_burn = (plan.cutoff > plan.turn_start) & (time < plan.cutoff + pointing.look_away_limit)
    back_mode = jnp.where(after_burn, Mode.TURN_BACK, Mode.SEARCH)
    tracking_mode = jnp.where(searching, Mode.SEARCH, jnp.where(slewing, back_mode, Mode.LOOK))
    return jnp.where(to_burn, away_mode, tracking_mode)
