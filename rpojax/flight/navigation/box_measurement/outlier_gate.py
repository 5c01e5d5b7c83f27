"""Outlier gate for boxes: innovation test, confirmation by a second box, and recovery after rejections."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.vectors import product
from rpojax.flight.navigation import outline_correlation
from rpojax.flight.navigation.box_measurement import detection_model
from rpojax.flight.navigation.box_measurement.box_measurement_model import PriorBox
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, BoxView

Scalar = Float[Array, ""]

_REJECTION_DECAY = 0.95
"""Factor on the evidence of rejections for a second without a box that others confirm. A choice: half of it is left
after 14 s."""


_LEAST_ODDS = 300.0
"""Odds that a box is one of the target's at which recent boxes confirm it. A choice: with a false box in one of twenty
frames one other box confirms it that is no more than 2 s away, with one in every second frame it takes two."""


_CLUTTER_TIME = 30.0
"""Time constant of the share of frames with a false box, and the least number of frames it takes [s]. A choice: a sixth
of a search of all directions; with 0.05 of them, it strays by 0.03."""


_CLUTTER_AT_FIRST = 0.05
"""Share of frames with a false box before any. A choice: that of the packaged camera."""


_CLUTTER_RANGE = (0.02, 0.9)
"""Limits of the share by which odds are told: a minute without a false box does not mean that there is none."""


_END_ON = 1.4
"""Allowed deviation of the size of a confirmed box over that of any box [-]. A choice: an outline of 0.42 of its mean
instead of 0.54. Much more, and the size would explain away a wrong range."""


_MEMORY = 3
"""Boxes before the present one that are asked about it. A choice: three are in the three seconds for which
`navigation.confirm_within_s` is set."""


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
    """Memory of the gate: of the last boxes, the latest first, and of rejections.

    Attributes:
        direction_N: (3, boxes) unit vectors
        log_size: (boxes,) [-]
        truncated: (boxes,) bool, the frame cut them
        age: (boxes,) from a box to the next frame [s]
        clutter: () fading share of frames with a box that no others confirm [-]
        contradicted: () bool, the last box was rejected although those before confirm it
        supported_age: () from the last box with which a recent one agreed to the next frame [s]
        recovered: () bool, the covariance is inflated after the last box
        rejections: () evidence of confirmed boxes rejected since the last accepted one, fading without any [s]
    """

    direction_N: Array
    log_size: Array
    truncated: Array
    age: Array
    clutter: Array
    contradicted: Array
    supported_age: Array
    recovered: Array
    rejections: Array


@pytree
class GateDecision:
    """Decision on a box.

    Attributes:
        accepted: () bool
        weight: () 1 if it is accepted, else 0, with the derivative of a smooth gate; that of a smooth gate times that
            of the box, if it has one
        confirmed: () bool, recent boxes that agree with it make it one of the target's
        supported: () bool, a recent box agrees with it
    """

    accepted: Array
    weight: Array
    confirmed: Array
    supported: Array

    @classmethod
    def without_gate(cls, accepted: Bool[Array, ""]) -> "GateDecision":
        """Decision in which other boxes have no part: each box is taken for one of the target's."""
        none = jnp.zeros_like(accepted)
        return cls(accepted=accepted, weight=jnp.where(accepted, 1.0, 0.0), confirmed=none, supported=accepted)


def initial() -> GateState:
    """State before the first frame."""
    return GateState(
        direction_N=jnp.zeros((3, _MEMORY), dtype=jnp.float64).at[2].set(1.0),
        log_size=jnp.zeros(_MEMORY, dtype=jnp.float64),
        truncated=jnp.zeros(_MEMORY, dtype=bool),
        age=jnp.full(_MEMORY, outline_correlation.NEVER, dtype=jnp.float64),
        clutter=jnp.full((), _CLUTTER_AT_FIRST, dtype=jnp.float64),
        contradicted=jnp.zeros((), dtype=bool),
        supported_age=jnp.full((), outline_correlation.NEVER, dtype=jnp.float64),
        recovered=jnp.zeros((), dtype=bool),
        rejections=jnp.zeros((), dtype=jnp.float64),
    )


def accept(
    tuning: OrbitFilterTuning, view: BoxView, state: GateState, prior: PriorBox, possible: Bool[Array, ""]
) -> GateDecision:
    """Whether the box is within the gate and, while the prior is wide, recent boxes confirm it.

    `possible` means that the predicted target can have such a box. Seen end-on, a target is smaller than a normal
    distribution of its size allows: where the bearing is right and recent boxes confirm this one, its size may be
    somewhat beyond the gate (`bounded_size_variance`). One far beyond it tells of a wrong range. A box with a weight
    gets one of the gate, too; what is decided and remembered is as of any other.
    """
    confirmed, supported = _agreement(tuning, view, state)
    bearing, size = _squared_ratios(view.box, prior)
    eased = jnp.where(confirmed & ~prior.is_wide, size / _END_ON**2, size)
    margin = tuning.gate_sigma**2 - jnp.maximum(bearing, eased)
    inside = gradient_safe.gate(margin, tuning.gate_slope_width)
    allowed = view.box.present & possible & (confirmed | ~prior.is_wide)
    accepted = allowed & (inside > 0.5)
    if view.box.weight is None:
        weight = jnp.where(allowed, inside, 0.0)
    else:
        smooth = view.box.weight * gradient_safe.smooth_gate(margin, tuning.gate_slope_width)
        weight = jnp.where(possible & (confirmed | ~prior.is_wide), smooth, 0.0)
    return GateDecision(
        accepted=accepted,
        weight=weight,
        confirmed=confirmed,
        supported=supported & view.box.present,
    )


def is_promising(tuning: OrbitFilterTuning, state: GateState) -> Bool[Array, ""]:
    """True if a box of the last few seconds had another one that agreed with it, and is not known to be no target."""
    return (state.supported_age <= tuning.confirm_within) & ~state.contradicted


def is_without_boxes(state: GateState) -> Bool[Array, ""]:
    """True while no two boxes have agreed with one another."""
    return state.supported_age >= outline_correlation.NEVER


def is_inside(tuning: OrbitFilterTuning, box: BoxMeasurement, prior: PriorBox) -> Bool[Array, ""]:
    """True if a box that has passed a gate before is within this one; its size may be that of one seen end-on."""
    bearing, size = _squared_ratios(box, prior)
    return jnp.maximum(bearing, jnp.where(prior.is_wide, size, size / _END_ON**2)) < tuning.gate_sigma**2


def _squared_ratios(box: BoxMeasurement, prior: PriorBox) -> tuple[Scalar, Scalar]:
    """Squared residuals over their variances, of the bearing (the greater) and of the size."""
    ratio = prior.residual**2 / prior.innovation_variance
    # The visible part of a truncated target may be smaller than the target, but not larger.
    size = jnp.where(box.truncated & (prior.residual[2] < 0.0), 0.0, ratio[2])
    return jnp.maximum(ratio[0], ratio[1]), size


def bounded_size_variance(tuning: OrbitFilterTuning, prior: PriorBox, variance: Scalar) -> Scalar:
    """Variance of the log-size of a box whose residual counts as no more than the edge of the gate.

    Beyond it the influence of a residual is bounded (Huber and Ronchetti, Robust Statistics, 2009, section 7.3); within
    it is the `variance` of the box [-].
    """
    excess = (prior.residual[2] / tuning.gate_sigma) ** 2 - prior.innovation_variance[2]
    return variance + jnp.maximum(excess, 0.0)


def _agreement(tuning: OrbitFilterTuning, view: BoxView, state: GateState) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
    """Whether recent boxes of nearly its direction in N and size make a box one of the target's, and if there are any.

    False boxes lie anywhere in the frame, so that one agrees by chance as often as the allowed angle has a share of it;
    how many there are shows in the boxes that nothing confirms. The odds are those of Bayes' rule (Blackman and Popoli,
    Design and Analysis of Modern Tracking Systems, 1999, section 6.2).
    """
    box, before = view.box, product(view.R_KN, state.direction_N)
    depth = jnp.where(before[2] > _LEAST_COSINE, before[2], _LEAST_COSINE)
    apart = jnp.max(jnp.abs(before[:2] / depth[None] - box.tangent[:, None]), axis=0)
    # Half an interval is more than the rounding of an age, and less than a frame.
    recent = state.age <= jnp.maximum(tuning.confirm_within, _MEMORY * box.interval) + 0.5 * box.interval
    time_apart = jnp.clip(state.age, _LEAST_CONFIRMATION_TIME, tuning.confirm_within)
    tolerance = tuning.confirm_tolerance * time_apart
    alike = (jnp.abs(box.log_size - state.log_size) < _SIZE_AGREEMENT) | box.truncated | state.truncated
    agrees = alike & (apart < tolerance) & (before[2] > _LEAST_COSINE)
    share_of_frame = jnp.minimum(jnp.prod(tolerance[None] / box.half_frame_tangent[:, None], axis=0), 1.0)
    clutter = jnp.clip(state.clutter, *_CLUTTER_RANGE)
    ratios = jnp.where(agrees, (1.0 - clutter) / share_of_frame, clutter)
    odds = (1.0 - clutter) / clutter * jnp.prod(jnp.where(recent, ratios, 1.0), axis=0)
    supported = jnp.any(recent & agrees, axis=0)
    # Whatever the clutter, which counts a target's own boxes while nothing confirms them.
    unanimous = jnp.all(recent & agrees, axis=0)
    return unanimous | (supported & (odds >= _LEAST_ODDS)), supported


def update(
    tuning: OrbitFilterTuning, view: BoxView, state: GateState, decision: GateDecision
) -> tuple[GateState, Bool[Array, ""]]:
    """State after a frame, and whether boxes were rejected for so long that the covariance should be inflated.

    Boxes that no others confirm say nothing against the estimate, however many there are; without others that do, the
    evidence of rejections decays.
    """
    box = view.box
    contradicted = box.present & ~decision.accepted & decision.confirmed
    ray_K = jnp.concatenate([box.tangent, jnp.ones_like(box.tangent[:1])])
    direction_N = quaternion.rotate(quaternion.conjugate(view.q_KN), gradient_safe.normalize(ray_K))
    idle = jnp.where(decision.accepted, 0.0, detection_model.fade(_REJECTION_DECAY, box.interval) * state.rejections)
    evidence = jnp.where(contradicted, state.rejections + detection_model.evidence_time(box.interval), idle)
    recover = evidence >= tuning.recovery_after - ROUNDING
    is_false = jnp.where(box.present & ~decision.accepted & ~decision.confirmed, 1.0, 0.0)
    faded = detection_model.evidence_time(box.interval) / _CLUTTER_TIME

    def remembered(latest: Array, before: Array) -> Array:
        shifted = jnp.concatenate([latest[..., None], before[..., :-1]], axis=-1)
        return jnp.where(box.present, shifted, before)

    after = GateState(
        direction_N=remembered(direction_N, state.direction_N),
        log_size=remembered(box.log_size, state.log_size),
        truncated=remembered(box.truncated, state.truncated),
        age=remembered(jnp.zeros_like(box.interval), state.age) + box.interval,
        clutter=state.clutter + faded * (is_false - state.clutter),
        contradicted=contradicted,
        supported_age=jnp.where(decision.supported, 0.0, state.supported_age) + box.interval,
        recovered=recover,
        rejections=jnp.where(recover, 0.0, evidence),
    )
    return after, recover
