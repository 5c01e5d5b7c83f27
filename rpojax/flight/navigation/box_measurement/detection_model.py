"""What a frame tells by having a box or none: a camera misses targets that appear too small.

Without it, the sizes of a target at the limit would be those of its large sides alone, and its range too short. The
probability of a box is a logistic function of the log of the apparent size; what it tells is used as a measurement of
that log with the mean and the variance of the posterior (assumed density filtering; Minka 2001).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Flag = Bool[Array, ""]

_LOGISTIC_SLOPE = 1.702
"""Slope of the logistic function that is nearest to the normal distribution function, by 0.0095 (Camilli, Origin of the
scaling constant d = 1.7 in item response theory, 1994)."""


_SURE_SIGMAS = 2.0
"""A target is found at any attitude (98 %) if its largest side is expected so many sigmas above the least one [-]."""


def may_be_too_small(tuning: OrbitFilterTuning, focal_px: Scalar, r_TS_N: Vector, log_scale: Scalar) -> Flag:
    """True if the camera may find no box of a target at `r_TS_N` [m] at some attitudes, as it appears too small.

    `log_scale` [-] is the estimated log of its size over the expected one.
    """
    offset, spread = tuning.largest_side_log[0], tuning.largest_side_log[1]
    variation = jnp.sqrt(spread**2 + tuning.scale_sigma[0] ** 2 + tuning.scale_sigma[1] ** 2)
    log_size_px = jnp.log(focal_px * tuning.target_size) + log_scale - 0.5 * jnp.log(jnp.sum(r_TS_N**2, axis=0))
    return log_size_px + offset - _SURE_SIGMAS * variation < jnp.log(tuning.minimum_size)


@pytree
class DetectionInformation:
    """What a frame tells of the log of the apparent size.

    Attributes:
        precision: () of the equivalent measurement [-]
        residual: () of that measurement times its precision [-]
    """

    precision: Array
    residual: Array


def detection_information(
    tuning: OrbitFilterTuning,
    log_size_px: Scalar,
    variance: Scalar,
    present: Flag,
    looked_for: Flag,
) -> DetectionInformation:
    """Information of a frame with a box (`present`), or without one where the target was `looked_for`.

    `log_size_px` is the log of the predicted size [px], with that variance.
    """
    offset, spread = tuning.largest_side_log[0], tuning.largest_side_log[1]
    total = variance + spread**2
    z = (log_size_px + offset - jnp.log(tuning.minimum_size)) / jnp.sqrt(total)
    seen = jax.nn.sigmoid(_LOGISTIC_SLOPE * z)
    found = 1.0 - tuning.miss_probability
    # Slope and curvature of the log likelihood in z.
    slope_present, curvature_present = _LOGISTIC_SLOPE * (1.0 - seen), _LOGISTIC_SLOPE**2 * seen * (1.0 - seen)
    slope_absent = -_LOGISTIC_SLOPE * found * seen * (1.0 - seen) / (1.0 - found * seen)
    curvature_absent = slope_absent * (slope_absent - _LOGISTIC_SLOPE * (1.0 - 2.0 * seen))
    slope = jnp.where(present, slope_present, jnp.where(looked_for, slope_absent, 0.0))
    curvature = jnp.where(present, curvature_present, jnp.where(looked_for, jnp.maximum(curvature_absent, 0.0), 0.0))
    left = 1.0 - curvature * variance / total
    return DetectionInformation(precision=curvature / total / left, residual=slope / jnp.sqrt(total) / left)


_LONGEST_EVIDENCE_S = 1.0
"""Longest time for which one frame speaks [s]: a single box may be false, however long it takes until the next. That of
the 1 Hz for which all times of evidence are set."""


def evidence_time(interval: Scalar | float) -> Scalar:
    """Time [s] for which a frame speaks that follows the one before it after `interval` [s].

    Frames of the same second show the target in nearly the same attitude and share the evidence of one frame.
    """
    return jnp.minimum(interval, _LONGEST_EVIDENCE_S)


def fade(factor: float, interval: Scalar | float) -> Scalar:
    """Factor on the evidence so far after a frame without a box; `factor` is that of a second without one."""
    return jnp.power(factor, evidence_time(interval))
