"""Target acquisition: when sightings are enough to count the target as acquired, or their absence as lost."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree
from rpojax.flight.guidance.pointing_tuning import GuidanceSoftware
from rpojax.flight.navigation.box_measurement import detection_model

Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@pytree
class Acquisition:
    """Acquisition state of the target.

    Attributes:
        acquired: () bool, the target has been acquired since it last came into the light
        recent_detections: () evidence of sightings, fading while the target should be seen and is not [s]
        unseen_time: () since the target was last seen, planned look-aways and darkness left out [s]
    """

    acquired: Array
    recent_detections: Array
    unseen_time: Array


@pytree
class Sighting:
    """What a frame shows of the target.

    Attributes:
        seen: () bool, a sensor has shown it
        promising: () bool, there is a box that may be the target's, not sure enough to count
    """

    seen: Array
    promising: Array


def never_seen() -> Acquisition:
    """State before the first frame."""
    zero = jnp.zeros((), dtype=jnp.float64)
    return Acquisition(acquired=jnp.zeros((), dtype=bool), recent_detections=zero, unseen_time=zero)


def update_acquisition(
    guidance: GuidanceSoftware, before: Acquisition, sighting: Sighting, visible: Flag, looking_away: Flag
) -> Acquisition:
    """Acquisition state after the frame of a tick; darkness (not `visible`) resets it."""
    target_seen = sighting.seen
    dt = guidance.tick_s
    recent_detections = _sum_detections(before.recent_detections, target_seen, visible, looking_away, dt)
    confirmed = target_seen & (recent_detections > ACQUISITION_EVIDENCE)
    acquired = (before.acquired & visible) | confirmed
    hold_time = max(SINGLE_BOX_HOLD_TIME, _FRAMES_TO_WAIT * dt)
    unseen_time = before.unseen_time + jnp.where(looking_away, 0.0, dt)
    # A single box may be false: it only holds the camera for a while, until further boxes confirm it.
    wait = search_wait(guidance, acquired)
    holds = target_seen | (sighting.promising & (unseen_time <= wait))
    unseen_time = jnp.where(holds, jnp.minimum(unseen_time, wait - hold_time), unseen_time)
    unseen_time = jnp.where(confirmed | ~visible, 0.0, unseen_time)
    return Acquisition(acquired=acquired, recent_detections=recent_detections, unseen_time=unseen_time)


def search_wait(guidance: GuidanceSoftware, acquired: Flag) -> Scalar:
    """Unseen time after which a search begins [s]."""
    wait = jnp.where(acquired, guidance.pointing.search_after, guidance.pointing.acquisition_wait)
    # A camera that is slower than these times gets a second and a third frame.
    return jnp.maximum(wait, _FRAMES_TO_WAIT * guidance.tick_s)


def _sum_detections(before: Scalar, target_seen: Flag, visible: Flag, looking_away: Flag, dt: float) -> Scalar:
    """Fading sum of the evidence of sightings [s]; unchanged during planned look-aways, zero in darkness."""
    gained, faded = before + detection_model.evidence_time(dt), detection_model.fade(_DETECTION_DECAY, dt) * before
    evidence = jnp.where(target_seen, gained, jnp.where(looking_away, before, faded))
    return jnp.where(visible, jnp.minimum(evidence, _MAX_DETECTION_EVIDENCE), 0.0)


_DETECTION_DECAY = 0.8
"""Factor on the evidence of detections for a second without one. A choice: half of it is left after 3 s."""


_MAX_DETECTION_EVIDENCE = 10.0
"""Largest evidence of detections, so that an acquired target is out of sight after 13 s without a box [s]; half or
twice as much makes it 10 or 17 s."""


ACQUISITION_EVIDENCE = 2.5
"""Evidence above which the target is seen: three boxes in a row at 1 Hz [s]. Accepted false boxes in 5 % of the frames
reach it in a third of all ten minutes; half as much in all, twice as much in none, with true ones in 6 s, not 3."""


LOSS_EVIDENCE = 0.5
"""Evidence below which an acquired target is out of sight; a detector that misses two of three boxes is below it for 4
% of the time [s]; half or twice as much makes that 1 or 13 %."""


_FRAMES_TO_WAIT = 2.5
"""Intervals of the camera that a search waits at least: three frames without a box [-], well apart from rounding."""


SINGLE_BOX_HOLD_TIME = 5.0
"""Time for which a single box keeps the camera from searching [s]. A choice: five frames at 1 Hz, two of which must
have another box."""
