"""Position of the target by one box: bearing and size, for a prior whose range is too uncertain to be linearised."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.vectors import apply, apply_transposed

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]

_LARGEST_LINEAR_SIGMA = 0.3
"""Sigma of the range over the range up to which the log of the range is nearly linear, twice that of a box [-]."""


def is_range_wide(r_TS_N: Vector, position_covariance: Matrix) -> Bool[Array, ""]:
    """True if the range of a target at `r_TS_N` [m] is too uncertain for a linearisation there."""
    along = jnp.sum(r_TS_N * apply(position_covariance, r_TS_N), axis=0)
    return along > _LARGEST_LINEAR_SIGMA**2 * jnp.sum(r_TS_N * r_TS_N, axis=0) ** 2


def position_by_box(R_KN: Matrix, target_size: Scalar, measured: Vector) -> Vector:
    """Position `r_TS_N` [m] of a target of `target_size` [m] that would have the `measured` (tangents, log-size)."""
    ray_K = jnp.concatenate([measured[:2], jnp.ones_like(measured[:1])])
    return apply_transposed(R_KN, target_size * jnp.exp(-measured[2]) * gradient_safe.normalize(ray_K))
