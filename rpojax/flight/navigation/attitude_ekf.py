"""Multiplicative extended Kalman filter of attitude and gyro bias, with star tracker and gyro.

The error `a` is a small rotation in body axes, `q_true = exp(a) q_estimate`; the second half of the error state is the
gyro bias. Lefferts, Markley, Shuster, "Kalman Filtering for Spacecraft Attitude Estimation", 1982.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import kalman_update, quaternion
from rpojax.core.declared_numbers import number
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.pytree import pytree, replace

Vector = Float[Array, "3"]


@pytree
class AttitudeFilterTuning:
    """Noise model of the attitude filter."""

    star_tracker_noise: Array = number(
        "noise of the star tracker about each body axis, 1 sigma", unit="deg", length=3, above=0.0
    )
    angle_random_walk: Array = number("white noise of the gyro: angle per root second", unit="deg_sqrt_s", above=0.0)
    bias_walk: Array = number("random walk of the gyro's bias, per root second", unit="deg_s_sqrt_s", at_least=0.0)
    initial_bias_sigma: Array = number("bias of the gyro at the start per axis, 1 sigma", unit="deg_s", above=0.0)


@pytree
class AttitudeEstimate:
    """Estimated attitude, rate and gyro bias with their covariance.

    Attributes:
        q_BN: (4,)
        omega_BN_B: (3,) gyro rate less bias [rad/s]
        bias_B: (3,) gyro bias [rad/s]
        gyro_B: (3,) last gyro sample [rad/s]
        covariance: (6, 6) of attitude error [rad] and bias [rad/s]
    """

    q_BN: Array
    omega_BN_B: Array
    bias_B: Array
    gyro_B: Array
    covariance: Array


def initial(tuning: AttitudeFilterTuning, q_BN: Float[Array, "4"], gyro_B: Vector) -> AttitudeEstimate:
    """Estimate from one star tracker and one gyro sample [rad/s]."""
    variance = jnp.concatenate([tuning.star_tracker_noise**2, jnp.full(3, tuning.initial_bias_sigma**2)])
    return AttitudeEstimate(
        q_BN=q_BN,
        omega_BN_B=gyro_B,
        bias_B=jnp.zeros_like(gyro_B),
        gyro_B=gyro_B,
        covariance=jnp.diag(variance),
    )


def integrate_gyro(
    estimate: AttitudeEstimate, gyro_B: Vector, dt: float, mean_B: Vector | None = None
) -> AttitudeEstimate:
    """Estimate with the attitude propagated over the `dt` [s] between two gyro samples [rad/s].

    The mean rate is the measured one [rad/s], or without one that of the two samples.
    """
    mean_rate = (0.5 * (estimate.gyro_B + gyro_B) if mean_B is None else mean_B) - estimate.bias_B
    return replace(
        estimate,
        q_BN=quaternion.propagate(estimate.q_BN, mean_rate, dt),
        omega_BN_B=gyro_B - estimate.bias_B,
        gyro_B=gyro_B,
    )


def predict_covariance(
    tuning: AttitudeFilterTuning, estimate: AttitudeEstimate, q_BN_before: Float[Array, "4"], dt: float
) -> AttitudeEstimate:
    """Estimate with its covariance propagated over `dt` [s], in which the attitude has left `q_BN_before`."""
    rotation = quaternion.to_matrix(quaternion.multiply(estimate.q_BN, quaternion.conjugate(q_BN_before)))
    P = estimate.covariance
    bias = P[3:, 3:]
    cross = _matrix_product(rotation, P[:3, 3:]) + dt * bias
    angle = _matrix_product(_matrix_product(rotation, P[:3, :3]), rotation.T)
    half = dt * _matrix_product(rotation, P[:3, 3:])
    identity = jnp.eye(3, dtype=P.dtype)
    angle = angle + half + half.T + dt * dt * bias + tuning.angle_random_walk**2 * dt * identity
    bias = bias + tuning.bias_walk**2 * dt * identity
    top = jnp.concatenate([angle, cross], axis=1)
    bottom = jnp.concatenate([cross.T, bias], axis=1)
    return replace(estimate, covariance=jnp.concatenate([top, bottom], axis=0))


def update(
    tuning: AttitudeFilterTuning,
    estimate: AttitudeEstimate,
    star_tracker_q_BN: Float[Array, "4"],
    present: Bool[Array, ""],
) -> AttitudeEstimate:
    """Estimate after a star tracker measurement; without one only the gyro counts."""
    residual = quaternion.log(quaternion.multiply(star_tracker_q_BN, quaternion.conjugate(estimate.q_BN)))
    rows = MeasurementRows(
        residual=residual,
        jacobian=jnp.eye(3, 6, dtype=residual.dtype),
        variance=tuning.star_tracker_noise**2,
        weight=jnp.full(3, jnp.where(present, 1.0, 0.0)),
    )
    result = kalman_update.update(estimate.covariance, rows)
    bias = estimate.bias_B + result.deviation[3:]
    q_BN = quaternion.multiply(quaternion.exp(result.deviation[:3]), estimate.q_BN)
    return replace(
        estimate,
        q_BN=quaternion.normalize(q_BN),
        bias_B=bias,
        omega_BN_B=estimate.gyro_B - bias,
        covariance=result.covariance,
    )


def _matrix_product(a: Float[Array, "3 3"], b: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Matrix product as an explicit sum."""
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)
