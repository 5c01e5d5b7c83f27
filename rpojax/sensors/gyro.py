"""Rate gyro with angle random walk and a bias that performs a random walk."""

import math

from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]


@pytree
class Gyro:
    """Errors of the three-axis rate gyro."""

    angle_random_walk: Array = number("white noise of the rate: angle per root second", unit="deg_sqrt_s", at_least=0.0)
    initial_bias_sigma: Array = number("bias at the start of a run per axis, 1 sigma", unit="deg_s", at_least=0.0)
    bias_walk: Array = number("random walk of the bias, per root second", unit="deg_s_sqrt_s", at_least=0.0)


def measure(gyro: Gyro, omega_BN_B: Vector, bias_B: Vector, normals: Vector, dt: float) -> Vector:
    """Measured rate [rad/s] for samples `dt` [s] apart."""
    return omega_BN_B + bias_B + gyro.angle_random_walk / math.sqrt(dt) * normals


def mean_rate(q_before_BN: Float[Array, "4"], q_after_BN: Float[Array, "4"], dt: float) -> Vector:
    """Mean rate [rad/s] over `dt` [s] between two attitudes."""
    return quaternion.log(quaternion.multiply(q_before_BN, quaternion.conjugate(q_after_BN))) / dt


def advance_bias(gyro: Gyro, bias_B: Vector, normals: Vector, dt: float) -> Vector:
    """Bias [rad/s] after `dt` [s] of random walk."""
    return bias_B + gyro.bias_walk * math.sqrt(dt) * normals
