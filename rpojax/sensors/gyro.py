"""Rate gyro with angle random walk and a bias that performs a random walk."""

import math

from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]


@pytree
class Gyro:
    """Errors of the three-axis rate gyro.

    Attributes:
        angle_random_walk: () [rad/s^0.5]
        initial_bias_sigma: () bias at the start of a run, 1 sigma per axis [rad/s]
        bias_walk: () growth of the bias [rad/s per s^0.5]
    """

    angle_random_walk: Array
    initial_bias_sigma: Array
    bias_walk: Array


def measure(gyro: Gyro, omega_BN_B: Vector, bias_B: Vector, normals: Vector, dt: float) -> Vector:
    """Measured rate [rad/s] for samples `dt` [s] apart."""
    return omega_BN_B + bias_B + gyro.angle_random_walk / math.sqrt(dt) * normals


def advance_bias(gyro: Gyro, bias_B: Vector, normals: Vector, dt: float) -> Vector:
    """Bias [rad/s] after `dt` [s] of random walk."""
    return bias_B + gyro.bias_walk * math.sqrt(dt) * normals
