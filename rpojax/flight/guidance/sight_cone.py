"""Cone of directions in which the target is seen, about the predicted one: what a scanned pattern is narrowed to."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2
from rpojax.core.pytree import pytree
from rpojax.flight.guidance import line_of_sight_uncertainty
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

_SIGMAS = 3.0


@pytree
class SightCone:
    """A cone of directions.

    Attributes:
        axis_B: (3,) unit vector
        half_angle: () [rad]
    """

    axis_B: Array
    half_angle: Array


def sight_cone(tuning: OrbitFilterTuning, estimate: OrbitEstimate, q_BN: Float[Array, "4"]) -> SightCone:
    """Cone that holds the predicted target with its largest outline, wherever it is within three sigma."""
    relative = estimate.relative
    largest = tuning.largest_side_log[0] + _SIGMAS * tuning.largest_side_log[1]
    radius = 0.5 * tuning.target_size * jnp.exp(largest)
    of_size = arctan2(radius, gradient_safe.norm(relative.r_TS_N))
    of_place = line_of_sight_uncertainty.uncertainty_cone(estimate, jnp.asarray(_SIGMAS, dtype=of_size.dtype))
    return SightCone(
        axis_B=quaternion.rotate(q_BN, gradient_safe.normalize(relative.r_TS_N)), half_angle=of_size + of_place
    )
