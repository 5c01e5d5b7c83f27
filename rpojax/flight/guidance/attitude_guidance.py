"""Attitude guidance: camera on the target, turn to the burn, burn, turn back; and a search when the target is lost.

The pointing schedule follows Figure 5 of the re-implemented paper; its times come from the slew that the wheels can do.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.flight.guidance import search_spiral, slew_profile
from rpojax.flight.guidance.burn_planning import BurnPlan
from rpojax.flight.guidance.pointing_modes import Mode, PointingTuning
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.flight.guidance.target_pointing import look_attitude
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@pytree
class PointingState:
    """Memory of the attitude guidance.

    Attributes:
        reference: the present reference
        to_burn: () bool, the end attitude is the burn's
        acquired: () bool, the target has been seen for sure since it last came into the light
        sightings: () accepted boxes of late, fading with every frame that looks and sees none [-]
        unseen_time: () since the last accepted box, planned look-aways and darkness left out [s]
        search_time: () since the search began; 0 when not searching [s]
    """

    reference: SlewReference
    burn_attitude_commanded: Array
    acquired: Array
    recent_detections: Array
    unseen_time: Array
    search_time: Array


def initial_pointing(vehicle: VehicleModel, estimate: OrbitEstimate) -> PointingState:
    """Camera on the estimated target, no slew under way."""
    q_EN, omega = look_attitude(vehicle, estimate)
    zero = jnp.zeros((), dtype=jnp.float64)
    reference = SlewReference(
        q_EN=q_EN, omega_EN_E=omega, remainder=jnp.zeros(3), slew_age=zero, slew_time=jnp.ones((), dtype=jnp.float64)
    )
    never = jnp.zeros((), dtype=bool)
    return PointingState(
        reference=reference,
        burn_attitude_commanded=never,
        acquired=never,
        recent_detections=zero,
        unseen_time=zero,
        search_time=zero,
    )


def is_lost(pointing: PointingTuning, state: PointingState) -> Flag:
    """True when the target has not been seen for too long, or not yet since it came into the light."""
    return (
        (state.unseen_time > pointing.search_after)
        | ~state.acquired
        | (state.recent_detections < search_spiral.ACQUISITION_COUNT)
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
) -> tuple[PointingState, Array]:
    """Reference for the next `dt` [s] and the present mode; in the dark (not `visible`) nothing is searched for."""
    visible = visible | box_accepted
    burn_attitude_commanded = (time >= plan.turn_start - _TIME_TOLERANCE) & (time < plan.cutoff)
    looking_away = burn_attitude_commanded | (state.burn_attitude_commanded | _slewing_back(state)) & ~box_accepted
    recent_detections = search_spiral.count_detections(state.recent_detections, box_accepted, visible, looking_away)
    confirmed = box_accepted & (recent_detections > search_spiral.ACQUISITION_COUNT)
    acquired = (state.acquired & visible) | confirmed
    wait = jnp.where(acquired, pointing.search_after, pointing.acquisition_wait)
    unseen_time = state.unseen_time + jnp.where(looking_away, 0.0, dt)
    # One box may be false: it makes the camera stay for a while, the next one makes it believe.
    unseen_time = jnp.where(
        box_accepted, jnp.minimum(unseen_time, wait - search_spiral.SINGLE_BOX_HOLD_TIME), unseen_time
    )
    unseen_time = jnp.where(confirmed | ~visible, 0.0, unseen_time)
    searching = (unseen_time > wait) & ~burn_attitude_commanded
    search_time = jnp.where(searching, search_spiral.wrap_spiral_time(pointing, estimate, state.search_time + dt), 0.0)

    q_look, omega_look = look_attitude(vehicle, estimate)
    offset_K, offset_rate_K = search_spiral.spiral_offset(pointing, search_time)
    q_BK = quaternion.conjugate(quaternion.normalize(vehicle.camera_mounting))
    q_search = quaternion.multiply(quaternion.exp(-rotate(q_BK, offset_K)), q_look)
    q_target = jnp.where(searching, q_search, q_look)
    omega_target = omega_look + jnp.where(searching, rotate(q_BK, offset_rate_K), 0.0)
    q_end = jnp.where(burn_attitude_commanded, plan.q_burn, q_target)
    omega_end = jnp.where(burn_attitude_commanded, 0.0, omega_target)

    reference = slew_profile.retarget(
        pointing, state.reference, q_end, omega_end, burn_attitude_commanded != state.burn_attitude_commanded, dt
    )
    slewing = reference.slew_age < reference.slew_time
    away_mode = jnp.where(time >= plan.ignition, Mode.BURN, Mode.TURN)
    # A burn that was called off has a turn, too.
    after_burn = (plan.cutoff > plan.turn_start) & (time < plan.cutoff + pointing.look_away_limit)
    back_mode = jnp.where(after_burn, Mode.TURN_BACK, Mode.SEARCH)
    tracking_mode = jnp.where(searching, Mode.SEARCH, jnp.where(slewing, back_mode, Mode.LOOK))
    mode = jnp.where(burn_attitude_commanded, away_mode, tracking_mode)
    after = PointingState(
        reference=reference,
        burn_attitude_commanded=burn_attitude_commanded,
        acquired=acquired,
        recent_detections=recent_detections,
        unseen_time=unseen_time,
        search_time=search_time,
    )
    return after, mode


_TIME_TOLERANCE = 1e-6
"""The turn to a burn of the longest duration begins on a whole tick, and rounding must not put it off by one [s]."""


def _slewing_back(state: PointingState) -> Flag:
    return ~state.burn_attitude_commanded & (state.reference.slew_age < state.reference.slew_time)
