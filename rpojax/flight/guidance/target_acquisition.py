"""Target acquisition: when accepted boxes are enough to count the target as seen, or their absence as lost."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.flight.guidance.pointing_tuning import PointingTuning

Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@dataclass(frozen=True)
class Acquisition:
    """Acquisition state of the target.

    Attributes:
        recent_detections: () accepted boxes, fading with every frame that should show the target and does not [-]
        acquired: () bool, enough boxes since the target last came into the light
        unseen_time: () since the last accepted box, planned look-aways and darkness left out [s]
        wait: () unseen time after which a search begins [s]
    """

    recent_detections: Array
    acquired: Array
    unseen_time: Array
    wait: Array


def update_acquisition(
    pointing: PointingTuning,
    recent_detections: Scalar,
    acquired: Flag,
    unseen_time: Scalar,
    box_accepted: Flag,
    visible: Flag,
    looking_away: Flag,
    dt: float,
) -> Acquisition:
    """Acquisition state after a frame, `dt` [s] after the one before it; darkness (not `visible`) resets it."""
    recent_detections = count_detections(recent_detections, box_accepted, visible, looking_away)
    confirmed = box_accepted & (recent_detections > ACQUISITION_COUNT)
    acquired = (acquired & visible) | confirmed
    wait = jnp.where(acquired, pointing.search_after, pointing.acquisition_wait)
    unseen_time = unseen_time + jnp.where(looking_away, 0.0, dt)
    # A single box may be false: it only holds the camera for a while, until further boxes confirm it.
    unseen_time = jnp.where(box_accepted, jnp.minimum(unseen_time, wait - SINGLE_BOX_HOLD_TIME), unseen_time)
    unseen_time = jnp.where(confirmed | ~visible, 0.0, unseen_time)
    return Acquisition(recent_detections=recent_detections, acquired=acquired, unseen_time=unseen_time, wait=wait)


def count_detections(before: Scalar, accepted: Flag, visible: Flag, looking_away: Flag) -> Scalar:
    """Fading count of accepted boxes [-]; unchanged during planned look-aways, zero in darkness."""
    count = jnp.where(accepted, before + 1.0, jnp.where(looking_away, before, _DETECTION_DECAY * before))
    return jnp.where(visible, jnp.minimum(count, _MAX_DETECTION_COUNT), 0.0)


_DETECTION_DECAY = 0.8
"""Factor on the count of detections for a frame without one."""


_MAX_DETECTION_COUNT = 10.0
"""Largest count of detections, so that it fades within half a minute."""


ACQUISITION_COUNT = 2.5
"""Count of detections above which the target is seen: false boxes come once in twenty frames and rarely agree."""


SINGLE_BOX_HOLD_TIME = 5.0
"""Time for which a single box keeps the camera from searching [s]."""
