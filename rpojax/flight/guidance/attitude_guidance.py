"""Attitude guidance: camera on the target, turn to the burn, burn, turn back; and a search when the target is lost.

The pointing schedule follows Figure 5 of the re-implemented paper; its times come from the slew that the wheels can do.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.flight.guidance import search_spiral, slew_profile
from rpojax.flight.guidance.burn_timing import BurnPlan
from rpojax.flight.guidance.pointing_modes import Mode, Pointing
from rpojax.flight.guidance.slew_profile import Reference
from rpojax.flight.guidance.target_pointing import look_attitude
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import Onboard

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

    reference: Reference
    to_burn: Array
    acquired: Array
    sightings: Array
    unseen_time: Array
    search_time: Array


def initial_pointing(onboard: Onboard, estimate: OrbitEstimate) -> PointingState:
    """Camera on the estimated target, no slew under way."""
    q_EN, omega = look_attitude(onboard, estimate)
    zero = jnp.zeros((), dtype=jnp.float64)
    reference = Reference(
        q_EN=q_EN, omega_EN_E=omega, remainder=jnp.zeros(3), slew_age=zero, slew_time=jnp.ones((), dtype=jnp.float64)
    )
    never = jnp.zeros((), dtype=bool)
    return PointingState(
        reference=reference, to_burn=never, acquired=never, sightings=zero, unseen_time=zero, search_time=zero
    )


def is_lost(pointing: Pointing, state: PointingState) -> Flag:
    """True when the target has not been seen for too long, or not yet since it came into the light."""
    return (state.unseen_time > pointing.search_after) | ~state.acquired | (state.sightings < search_spiral.SURE)


def guide(
    pointing: Pointing,
    onboard: Onboard,
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
    to_burn = (time >= plan.turn_start - _ON_THE_DOT) & (time < plan.cutoff)
    looking_away = to_burn | (state.to_burn | _slewing_back(state)) & ~box_accepted
    sightings = search_spiral.count_sightings(state.sightings, box_accepted, visible, looking_away)
    sure = box_accepted & (sightings > search_spiral.SURE)
    acquired = (state.acquired & visible) | sure
    patience = jnp.where(acquired, pointing.search_after, pointing.acquisition_wait)
    unseen = state.unseen_time + jnp.where(looking_away, 0.0, dt)
    # One box may be false: it makes the camera stay for a while, the next one makes it believe.
    unseen = jnp.where(box_accepted, jnp.minimum(unseen, patience - search_spiral.STARE), unseen)
    unseen = jnp.where(sure | ~visible, 0.0, unseen)
    searching = (unseen > patience) & ~to_burn
    search_time = jnp.where(searching, search_spiral.search_clock(pointing, estimate, state.search_time + dt), 0.0)

    q_look, omega_look = look_attitude(onboard, estimate)
    offset_K, offset_rate_K = search_spiral.spiral(pointing, search_time)
    q_BK = quaternion.conjugate(quaternion.normalize(onboard.camera_mounting))
    q_search = quaternion.multiply(quaternion.exp(-rotate(q_BK, offset_K)), q_look)
    q_home = jnp.where(searching, q_search, q_look)
    omega_home = omega_look + jnp.where(searching, rotate(q_BK, offset_rate_K), 0.0)
    q_end = jnp.where(to_burn, plan.q_burn, q_home)
    omega_end = jnp.where(to_burn, 0.0, omega_home)

    reference = slew_profile.retarget(pointing, state.reference, q_end, omega_end, to_burn != state.to_burn, dt)
    slewing = reference.slew_age < reference.slew_time
    away = jnp.where(time >= plan.ignition, Mode.BURN, Mode.TURN)
    # A burn that was called off has a turn, too.
    after_burn = (plan.cutoff > plan.turn_start) & (time < plan.cutoff + pointing.look_away_limit)
    back = jnp.where(after_burn, Mode.TURN_BACK, Mode.SEARCH)
    home = jnp.where(searching, Mode.SEARCH, jnp.where(slewing, back, Mode.LOOK))
    mode = jnp.where(to_burn, away, home)
    after = PointingState(
        reference=reference,
        to_burn=to_burn,
        acquired=acquired,
        sightings=sightings,
        unseen_time=unseen,
        search_time=search_time,
    )
    return after, mode


_ON_THE_DOT = 1e-6
"""The turn to a burn of the longest duration begins on a whole tick, and rounding must not put it off by one [s]."""


def _slewing_back(state: PointingState) -> Flag:
    return ~state.to_burn & (state.reference.slew_age < state.reference.slew_time)
