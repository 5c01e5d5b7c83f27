"""Uncertainty of range and bearing to the estimated target."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2
from rpojax.core.vectors import apply
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

Scalar = Float[Array, ""]


def relative_range_sigma(estimate: OrbitEstimate) -> Scalar:
    """1-sigma of the range over the range [-]."""
    line_of_sight = gradient_safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.position_covariance
    return gradient_safe.sqrt(jnp.sum(line_of_sight * apply(P, line_of_sight), axis=0)) / gradient_safe.norm(
        estimate.relative.r_TS_N
    )


def bearing_sigma(estimate: OrbitEstimate) -> Scalar:
    """Upper bound of the bearing's 1-sigma in any direction [rad]: root of the trace across the line of sight."""
    line_of_sight = gradient_safe.normalize(estimate.relative.r_TS_N)
    P = estimate.relative.position_covariance
    across = P[0, 0] + P[1, 1] + P[2, 2] - jnp.sum(line_of_sight * apply(P, line_of_sight), axis=0)
    return gradient_safe.sqrt(across) / gradient_safe.norm(estimate.relative.r_TS_N)


def uncertainty_cone(estimate: OrbitEstimate, sigmas: Scalar) -> Scalar:
    """Half-angle [rad] of the cone of directions in which the target is within some `sigmas` [-] of its estimate.

    It touches the ellipsoid of uncertainty; a servicer inside of that has the target in any direction. An upper bound,
    close for small angles.
    """
    along = sigmas * relative_range_sigma(estimate)
    outside = gradient_safe.sqrt(jnp.maximum(1.0 - along * along, _LEAST_OUTSIDE))
    return jnp.minimum(sigmas * bearing_sigma(estimate) / outside, math.pi)


def is_within_frame(estimate: OrbitEstimate, sigmas: Scalar, half_frame_tangent: Float[Array, "2"]) -> Bool[Array, ""]:
    """Whether a frame centred on the estimate shows the target wherever it is within some `sigmas` [-].

    `half_frame_tangent` are the tangents of half of the frame's angles.
    """
    half_angle = arctan2(jnp.min(half_frame_tangent, axis=0), jnp.ones_like(half_frame_tangent[0]))
    return uncertainty_cone(estimate, sigmas) < half_angle


_LEAST_OUTSIDE = 1e-4
"""Bound of a squared cosine that is zero where the cone opens to a half-space [-]: that of 100 bearing sigmas."""
