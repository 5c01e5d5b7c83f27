"""Uncertainty of range and bearing to the estimated target."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.vectors import apply
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

Scalar = Float[Array, ""]


def relative_range_sigma(estimate: OrbitEstimate) -> Scalar:
    """1-sigma of the range over the range [-]."""
    line_of_sight = gradient_safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.covariance[:3, :3]
    return gradient_safe.sqrt(jnp.sum(line_of_sight * apply(P, line_of_sight), axis=0)) / gradient_safe.norm(
        estimate.relative.r_TS_N
    )


def bearing_sigma(estimate: OrbitEstimate) -> Scalar:
    """Upper bound of the bearing's 1-sigma in any direction [rad]: root of the trace across the line of sight."""
    line_of_sight = gradient_safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.covariance[:3, :3]
    across = P[0, 0] + P[1, 1] + P[2, 2] - jnp.sum(line_of_sight * apply(P, line_of_sight), axis=0)
    return gradient_safe.sqrt(across) / gradient_safe.norm(estimate.relative.r_TS_N)
