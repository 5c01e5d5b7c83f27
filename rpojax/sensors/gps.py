"""GPS receiver: position of the servicer with white noise and a slowly varying error; differences of two receivers."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]


@pytree
class Gps:
    """Errors of the GPS receiver."""

    noise: Array = number("white noise per axis, 1 sigma", unit="m", at_least=0.0)
    bias_sigma: Array = number("slowly varying error per axis, 1 sigma", unit="m", at_least=0.0)
    bias_time_constant: Array = number("its correlation time", unit="s", above=0.0)
    common_share: Array = number(
        "part of its variance that the receivers of a team have in common and that cancels in differences "
        "(ionosphere, ephemerides); the rest is each receiver's own",
        at_least=0.0,
        at_most=1.0,
        default=0.9,
    )


@pytree
class GpsDifferences:
    """Errors of the difference of two receivers' positions by carrier phase."""

    noise: Array = number(
        "white noise per axis of a difference by carrier phase, 1 sigma", unit="m", at_least=0.0, default=0.05
    )
    slow_error: Array = number("its slowly varying error per axis, 1 sigma", unit="m", at_least=0.0, default=0.007)
    slow_error_time_constant: Array = number("its correlation time", unit="s", above=0.0, default=700.0)


def measure(gps: Gps, r_SN_N: Vector, bias_N: Vector, normals: Vector) -> Vector:
    """Measured position [m] in N."""
    return r_SN_N + bias_N + gps.noise * normals


def advance_bias(gps: Gps, bias_N: Vector, normals: Vector, dt: float) -> Vector:
    """Slowly varying error [m] after `dt` [s]: first-order Gauss-Markov, stationary."""
    decay = jnp.exp(-dt / gps.bias_time_constant)
    return decay * bias_N + gps.bias_sigma * jnp.sqrt(1.0 - decay * decay) * normals
