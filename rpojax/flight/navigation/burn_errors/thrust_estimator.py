"""Scalar Kalman filter of the thrust: its calibration, corrected by the chamber pressure during burns."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]

PRESSURE_NOISE = 0.03
"""Error of the pressure sensor, 1 sigma, as a fraction of the nominal pressure."""
CALIBRATION_SIGMA = 0.015
"""Error of the thruster's calibration, 1 sigma [-]."""
THRUST_RANDOM_WALK = 0.01
"""Change of the thrust ratio in a second of burning, 1 sigma [-]."""
JUMP_SIGMAS = 4.0
"""Innovations beyond this many sigma indicate a failure and reset the prior variance to 1."""


@pytree
class ThrustEstimate:
    """Estimated thrust over its nominal value.

    Attributes:
        ratio: () [-]
        variance: () [-]
    """

    ratio: Array
    variance: Array


def initial() -> ThrustEstimate:
    """Estimate from the calibration."""
    return ThrustEstimate(
        ratio=jnp.ones((), dtype=jnp.float64), variance=jnp.full((), CALIBRATION_SIGMA**2, dtype=jnp.float64)
    )


def update(estimate: ThrustEstimate, pressure: Scalar, dt: float) -> ThrustEstimate:
    """Estimate after `dt` [s] of burning with a mean chamber pressure over its nominal value [-]."""
    innovation = pressure - estimate.ratio
    prior = estimate.variance + THRUST_RANDOM_WALK**2 * dt
    noise = PRESSURE_NOISE**2
    prior = jnp.where(innovation**2 > JUMP_SIGMAS**2 * (prior + noise), 1.0, prior)
    gain = prior / (prior + noise)
    return ThrustEstimate(ratio=estimate.ratio + gain * innovation, variance=(1.0 - gain) * prior)


def sigma_inflation(estimate: ThrustEstimate) -> Scalar:
    """Ratio of the thrust's sigma to that of a calibrated thruster, at least 1 [-]."""
    settled = 1.2 * CALIBRATION_SIGMA
    return jnp.maximum(jnp.sqrt(estimate.variance) / settled, 1.0)
