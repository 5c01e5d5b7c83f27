"""GPS receiver: position of the servicer with white noise and a slowly varying error; differences of two receivers."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]


@pytree
class Gps:
    """Errors of the GPS receiver.

    Attributes:
        noise: () white noise, 1 sigma per axis [m]
        bias_sigma: () slowly varying error, 1 sigma per axis [m]
        bias_time_constant: () its correlation time [s]
        common_share: () part of its variance that receivers near each other have in common [-]
    """

    noise: Array
    bias_sigma: Array
    bias_time_constant: Array
    common_share: Array


@pytree
class GpsDifferences:
    """Errors of the difference of two receivers' positions by carrier phase.

    Attributes:
        noise: () white noise, 1 sigma per axis [m]
        slow_error: () slowly varying error, 1 sigma per axis [m]
        slow_error_time_constant: () its correlation time [s]
    """

    noise: Array
    slow_error: Array
    slow_error_time_constant: Array


def measure(gps: Gps, r_SN_N: Vector, bias_N: Vector, normals: Vector) -> Vector:
    """Measured position [m] in N."""
    return r_SN_N + bias_N + gps.noise * normals


def advance_bias(gps: Gps, bias_N: Vector, normals: Vector, dt: float) -> Vector:
    """Slowly varying error [m] after `dt` [s]: first-order Gauss-Markov, stationary."""
    decay = jnp.exp(-dt / gps.bias_time_constant)
    return decay * bias_N + gps.bias_sigma * jnp.sqrt(1.0 - decay * decay) * normals
