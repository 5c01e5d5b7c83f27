"""Target acquisition: when accepted boxes are enough to count the target as seen, or their absence as lost."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.navigation.box_measurement import box_evidence

Scalar = Float[Array, ""]
Flag = Bool[Array, ""]


@dataclass(frozen=True)
class Acquisition:
    """Acquisition state of the target.

    Attributes:
        recent_detections: () evidence of accepted boxes, fading while the target should be seen and is not [s]
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
    recent_detections = sum_detections(recent_detections, box_accepted, visible, looking_away, dt)
    confirmed = box_accepted & (recent_detections > ACQUISITION_EVIDENCE)
    acquired = (acquired & visible) | confirmed
    # A camera that is slower than these times gets a second and a third frame.
    wait = jnp.maximum(jnp.where(acquired, pointing.search_after, pointing.acquisition_wait), _FRAMES_TO_WAIT * dt)
    hold_time = max(SINGLE_BOX_HOLD_TIME, _FRAMES_TO_WAIT * dt)
    unseen_time = unseen_time + jnp.where(looking_away, 0.0, dt)
    # A single box may be false: it only holds the camera for a while, until further boxes confirm it.
    unseen_time = jnp.where(box_accepted, jnp.minimum(unseen_time, wait - hold_time), unseen_time)
    unseen_time = jnp.where(confirmed | ~visible, 0.0, unseen_time)
    return Acquisition(recent_detections=recent_detections, acquired=acquired, unseen_time=unseen_time, wait=wait)


def sum_detections(before: Scalar, accepted: Flag, visible: Flag, looking_away: Flag, dt: float) -> Scalar:
    """Fading sum of the evidence of accepted boxes [s]; unchanged during planned look-aways, zero in darkness."""
    gained, faded = before + box_evidence.evidence_time(dt), box_evidence.fade(_DETECTION_DECAY, dt) * before
    evidence = jnp.where(accepted, gained, jnp.where(looking_away, before, faded))
    return jnp.where(visible, jnp.minimum(evidence, _MAX_DETECTION_EVIDENCE), 0.0)


_DETECTION_DECAY = 0.8
"""Factor on the evidence of detections for a second without one."""


_MAX_DETECTION_EVIDENCE = 10.0
"""Largest evidence of detections, so that it fades within half a minute [s]."""


ACQUISITION_EVIDENCE = 2.5
"""Evidence above which the target is seen: false boxes come once in twenty frames and rarely agree [s]."""


LOSS_EVIDENCE = 0.5
"""Evidence below which an acquired target is out of sight; a detector that misses two of three boxes has more [s]."""


_FRAMES_TO_WAIT = 2.5
"""Intervals of the camera that a search waits at least: three frames without a box [-]."""


SINGLE_BOX_HOLD_TIME = 5.0
"""Time for which a single box keeps the camera from searching [s]."""
