"""Outlier gate for boxes: innovation test, confirmation by a second box, and recovery after rejections."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply
from rpojax.flight.navigation import outline_correlation
from rpojax.flight.navigation.box_measurement import detection_model
from rpojax.flight.navigation.box_measurement.box_measurement_model import PriorBox
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, BoxView

Scalar = Float[Array, ""]

GATE_WIDTH = 0.25
"""Width of the gate's smooth derivative, in squared sigmas. Only gradients depend on it (experiments/tuning)."""


_REJECTION_DECAY = 0.95
"""Factor on the evidence of rejections for a second without a box. False boxes in 5 % of the frames of an unseen target
widen its estimate (after 6 s of them) in 3 % of all hours, with 0.975 in 64 %, with 0.9 in 0.05 %."""


_LEAST_CONFIRMATION_TIME = 1.0
"""Two boxes may differ by as much as two that are this long apart, since each has its own noise [s]: the frame of 1 Hz
for which `navigation.confirm_tolerance_deg_s` is declared."""


_SIZE_AGREEMENT = 0.5
"""Difference of the log-sizes of two boxes that confirm each other: edge noise, and the tumble in between [-]. A
choice: 2.3 sigma of two independent views of the packaged hull (0.154 each)."""


ROUNDING = 1e-3
"""Rounding of a sum of intervals, more than that of single precision [s]: 1e-6 at some seconds."""


_LEAST_COSINE = 0.1
"""Cosine of 84 deg: a box farther off the boresight confirms none, and tangents diverge [-]."""


@pytree
class GateState:
    """Memory of the gate.

    Attributes:
        direction_N: (3,) unit vector of the last box
        log_size: () of the last box [-]
        truncated: () bool, the frame cut it
        age: () from that box to the next frame [s]
        contradicted: () bool, the last box was rejected although the one before confirms it
        recovered: () bool, the covariance is inflated after the last box
        rejections: () evidence of the boxes rejected since the last accepted one, fading while there is no box [s]
    """

    direction_N: Array
    log_size: Array
    truncated: Array
    age: Array
    contradicted: Array
    recovered: Array
    rejections: Array


@pytree
class GateDecision:
    """Decision on a box.

    Attributes:
        accepted: () bool
        weight: () 1 if it is accepted, else 0, with the derivative of a smooth gate
        confirmed: () bool, a recent box agrees with it
    """

    accepted: Array
    weight: Array
    confirmed: Array


def initial() -> GateState:
    """State before the first frame."""
    return GateState(
        direction_N=jnp.array([0.0, 0.0, 1.0], dtype=jnp.float64),
        log_size=jnp.zeros((), dtype=jnp.float64),
        truncated=jnp.zeros((), dtype=bool),
        age=jnp.full((), outline_correlation.NEVER, dtype=jnp.float64),
        contradicted=jnp.zeros((), dtype=bool),
        recovered=jnp.zeros((), dtype=bool),
        rejections=jnp.zeros((), dtype=jnp.float64),
    )


def accept(
    tuning: OrbitFilterTuning, view: BoxView, state: GateState, prior: PriorBox, possible: Bool[Array, ""]
) -> GateDecision:
    """Whether the box is within the gate and, while the prior is wide, a recent box confirms it.

    `possible` means that the predicted target can have such a box.
    """
    margin = tuning.gate_sigma**2 - _worst_ratio(view.box, prior)
    inside = gradient_safe.gate(margin, jnp.asarray(GATE_WIDTH, dtype=margin.dtype))
    confirmed = _is_confirmed(tuning, view, state)
    allowed = view.box.present & possible & (confirmed | ~prior.is_wide)
    return GateDecision(accepted=allowed & (inside > 0.5), weight=jnp.where(allowed, inside, 0.0), confirmed=confirmed)


def is_inside(tuning: OrbitFilterTuning, box: BoxMeasurement, prior: PriorBox) -> Bool[Array, ""]:
    """True if the box is within the gate."""
    return _worst_ratio(box, prior) < tuning.gate_sigma**2


def _worst_ratio(box: BoxMeasurement, prior: PriorBox) -> Scalar:
    """Largest squared residual over its variance."""
    ratio = prior.residual**2 / prior.innovation_variance
    bearing = jnp.maximum(ratio[0], ratio[1])
    # The visible part of a truncated target may be smaller than the target, but not larger.
    size = jnp.where(box.truncated & (prior.residual[2] < 0.0), 0.0, ratio[2])
    return jnp.maximum(bearing, size)


def _is_confirmed(tuning: OrbitFilterTuning, view: BoxView, state: GateState) -> Bool[Array, ""]:
    """True if a box of the last few seconds, or of the frame before, had nearly the same direction in N and size."""
    box, before = view.box, apply(view.R_KN, state.direction_N)
    depth = jnp.where(before[2] > _LEAST_COSINE, before[2], _LEAST_COSINE)
    apart = jnp.max(jnp.abs(before[:2] / depth - box.tangent), axis=0)
    # Half an interval is more than the rounding of an age, and less than a frame.
    recent = state.age <= jnp.maximum(tuning.confirm_within, box.interval) + 0.5 * box.interval
    time_apart = jnp.clip(state.age, _LEAST_CONFIRMATION_TIME, tuning.confirm_within)
    alike = (jnp.abs(box.log_size - state.log_size) < _SIZE_AGREEMENT) | box.truncated | state.truncated
    return recent & alike & (apart < tuning.confirm_tolerance * time_apart) & (before[2] > _LEAST_COSINE)


def update(
    tuning: OrbitFilterTuning, view: BoxView, state: GateState, decision: GateDecision
) -> tuple[GateState, Bool[Array, ""]]:
    """State after a frame, and whether boxes were rejected for so long that the covariance should be inflated.

    In frames without a box the evidence of rejections decays, so that isolated false boxes do not add up.
    """
    box, rejected = view.box, view.box.present & ~decision.accepted
    ray_K = jnp.concatenate([box.tangent, jnp.ones_like(box.tangent[:1])])
    direction_N = quaternion.rotate(quaternion.conjugate(view.q_KN), gradient_safe.normalize(ray_K))
    idle = jnp.where(box.present, 0.0, detection_model.fade(_REJECTION_DECAY, box.interval) * state.rejections)
    evidence = jnp.where(rejected, state.rejections + detection_model.evidence_time(box.interval), idle)
    recover = evidence >= tuning.recovery_after - ROUNDING
    after = GateState(
        direction_N=jnp.where(box.present, direction_N, state.direction_N),
        log_size=jnp.where(box.present, box.log_size, state.log_size),
        truncated=jnp.where(box.present, box.truncated, state.truncated),
        age=jnp.where(box.present, box.interval, state.age + box.interval),
        contradicted=rejected & decision.confirmed,
        recovered=recover,
        rejections=jnp.where(recover, 0.0, evidence),
    )
    return after, recover
