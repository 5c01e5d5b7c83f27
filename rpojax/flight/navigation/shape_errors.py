"""Errors of a box that come from the target's shape: of the log of its size, and of its centre."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree
from rpojax.core.vectors import cross
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]

_CONSTANT_CENTER_SHARE = 0.33
"""Part of the offset by perspective that a tumble does not average out; 0.4 of compact bodies (0.44 of the packaged
hull that spins about any axis), less what the bearing bias covers."""
_NOMINAL_TURN_RATE = 1.1e-3
"""Rate of a line of sight that turns once in 95 minutes [rad/s]: that at which `navigation.scale_time_constant_s` is
declared, whatever the true orbit. The rate itself is that of the estimate."""
_TURN_TIMES = (0.25, 40.0)
"""Limits of the correlation time of the slow part of the size, by that at the nominal rate: a line of sight that turns
four times as fast as in a low orbit, and one that turns more than twice as slowly as in the geostationary one (15)."""


@pytree
class ShapeErrors:
    """Stationary variances and correlation times of the errors, each a Gauss-Markov process.

    Attributes:
        scale_variance: (2,) of the log of the size, slow and fast part [-]
        scale_time_constant: (2,) [s]
        center_variance: () of the offset of the box centre from the centre of mass, per axis [m^2]
        center_time_constant: () [s]
        bearing_process_variance: () growth of the variance of a bearing by the lasting part of that offset [rad^2/s]
        landmark_decay_rate: () inverse of the correlation time of the pose that a landmark network shows, by how fast
            the target turns before the camera, None without one [1/s]
    """

    scale_variance: Array
    scale_time_constant: Array
    center_variance: Array
    center_time_constant: Array
    bearing_process_variance: Array
    landmark_decay_rate: Array | None = None


def shape_errors(
    tuning: OrbitFilterTuning, outline_correlation_time: Scalar, slow_scale: Scalar, r_TS_N: Vector, v_TS_N: Vector
) -> ShapeErrors:
    """Errors of the boxes of a target at `r_TS_N` [m] that moves by `v_TS_N` [m/s] from the servicer.

    `outline_correlation_time` [s] is that of its outline, `slow_scale` [-] the estimated log of its size over the
    expected one.

    What changes as the target tumbles loses its correlation with the outline: the fast part of the size, and the
    centre. The slow part of the size is that of the tumble axis to the line of sight, and the size itself: it changes
    as the line of sight turns: once an orbit from a station, about half as fast from an orbit around the target.
    """
    tempo = outline_correlation_time / tuning.outline_time_constant
    lasting_variance = _CONSTANT_CENTER_SHARE**2 * perspective_variance(tuning, slow_scale, r_TS_N)
    # The size itself stays: it adds to the variance, but not to its growth.
    constancy = 1.0 + tuning.target_size_sigma**2 / tuning.scale_sigma[0] ** 2
    slow = _turn_time(r_TS_N, v_TS_N)
    # The outline of a target that hardly tumbles changes no slower than the size of one seen from a low orbit.
    longest = tuning.scale_time_constant[0] / tuning.scale_time_constant[1]
    factors = jnp.stack([constancy * slow, jnp.minimum(tempo, longest)])
    return ShapeErrors(
        scale_variance=scale_variance(tuning),
        scale_time_constant=tuning.scale_time_constant * factors,
        center_variance=center_variance(tuning, slow_scale, r_TS_N),
        center_time_constant=tuning.center_time_constant * tempo,
        bearing_process_variance=2.0
        * lasting_variance
        / (jnp.sum(r_TS_N * r_TS_N, axis=0) * tuning.scale_time_constant[0] * slow),
    )


def _turn_time(r_TS_N: Vector, v_TS_N: Vector) -> Scalar:
    """Time in which the line of sight turns by an angle, by that at the nominal rate."""
    across = cross(r_TS_N, v_TS_N)
    square = jnp.sum(r_TS_N * r_TS_N, axis=0)
    shortest, longest = _TURN_TIMES
    # Rates are added to none in quadrature, so that the derivative is defined without motion.
    rate_square = jnp.sum(across * across, axis=0) / square**2 + (_NOMINAL_TURN_RATE / longest) ** 2
    return jnp.maximum(_NOMINAL_TURN_RATE / jnp.sqrt(rate_square), shortest)


def scale_variance(tuning: OrbitFilterTuning) -> Float[Array, "2"]:
    """Variance of the log of the size, slow and fast part [-]."""
    slow, fast = tuning.scale_sigma[0], tuning.scale_sigma[1]
    return jnp.stack([slow**2 + tuning.target_size_sigma**2, fast**2])


def center_variance(tuning: OrbitFilterTuning, slow_scale: Scalar, r_TS_N: Vector) -> Scalar:
    """Variance of the offset of the box centre, per axis [m^2]: of the shape, of a detector, and by perspective."""
    of_detector = tuning.detector_boxes * tuning.detector_center_sigma
    return gradient_safe.sqrt(tuning.center_sigma**2 + of_detector**2) ** 2 + perspective_variance(
        tuning, slow_scale, r_TS_N
    )


def perspective_variance(tuning: OrbitFilterTuning, slow_scale: Scalar, r_TS_N: Vector) -> Scalar:
    """Variance of the offset because nearer parts look greater, per axis [m^2]; it falls with the range."""
    size = tuning.target_size * jnp.exp(slow_scale)
    return (tuning.center_perspective * size**2) ** 2 / jnp.sum(r_TS_N * r_TS_N, axis=0)
