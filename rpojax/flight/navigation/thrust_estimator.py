"""Scalar Kalman filter of the thrust: its calibration, corrected by the chamber pressure during burns."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

Scalar = Float[Array, ""]

_JUMP_SIGMAS = 4.0
"""Innovations beyond this many sigma indicate a failure and reset the prior variance to 1: one of 16,000 samples of a
sound thruster, and the loss of all thrust in `inspection` is one of 29 sigma."""


@pytree
class ThrustEstimate:
    """Estimated thrust over its nominal value.

    Attributes:
        ratio: () [-]
        variance: () [-]
    """

    ratio: Array
    variance: Array


def initial(tuning: OrbitFilterTuning) -> ThrustEstimate:
    """Estimate from the calibration."""
    return ThrustEstimate(ratio=jnp.ones_like(tuning.thrust_sigma), variance=tuning.thrust_sigma**2)


def update(tuning: OrbitFilterTuning, estimate: ThrustEstimate, pressure: Scalar, dt: float) -> ThrustEstimate:
    """Estimate after `dt` [s] of burning with a mean chamber pressure over its nominal value [-]."""
    innovation = pressure - estimate.ratio
    prior = estimate.variance + tuning.thrust_walk**2 * dt
    noise = tuning.pressure_noise**2
    prior = jnp.where(innovation**2 > _JUMP_SIGMAS**2 * (prior + noise), 1.0, prior)
    gain = prior / (prior + noise)
    return ThrustEstimate(ratio=estimate.ratio + gain * innovation, variance=(1.0 - gain) * prior)


def sigma_inflation(tuning: OrbitFilterTuning, estimate: ThrustEstimate) -> Scalar:
    """Ratio of the thrust's sigma to that of a calibrated thruster, at least 1 [-]."""
    settled = _SETTLED * tuning.thrust_sigma
    return jnp.maximum(jnp.sqrt(estimate.variance) / settled, 1.0)


_SETTLED = 1.2
"""Sigma that pressure and random walk leave in a long burn, over that of the calibration, which is no reason for
inflation: 1.06 by the Riccati equation for the numbers of `inspection` at 1 Hz."""
