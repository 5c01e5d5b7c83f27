"""Visibility of the estimated target: light, phase angle and Sun exclusion of the camera."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.orbits import camera_visibility
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Flag = Bool[Array, ""]


def is_visible(vehicle: VehicleModel, estimate: OrbitEstimate, sun_N: Vector, tolerance: float = 0.0) -> Flag:
    """True while the target should be visible by the estimate, the Sun at `sun_N` [m] and the camera's limits.

    `tolerance` [rad] widens the limits.
    """
    r_TN_N = estimate.servicer.r_SN_N + estimate.relative.r_TS_N
    # Cosines are monotonous between zero and a half circle only.
    phase = jnp.minimum(vehicle.phase_limit + tolerance, math.pi)
    exclusion = jnp.maximum(vehicle.sun_exclusion - tolerance, 0.0)
    return camera_visibility.is_observable(r_TN_N, -estimate.relative.r_TS_N, sun_N, phase, exclusion)


VISIBILITY_TOLERANCE = math.radians(10.0)
"""Widening of the camera's light limits within which a box is accepted [rad]: the largest plausible bearing error."""
