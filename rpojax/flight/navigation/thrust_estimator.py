"""How hard the thruster pushes: its calibration, corrected second by second by the pressure in its chamber."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]

PRESSURE_NOISE = 0.03
"""Error of the pressure sensor, 1 sigma, as a share of the nominal pressure."""
CALIBRATION = 0.015
"""Error of the calibration that a burn starts from, 1 sigma."""
CHANGE = 0.01
"""What the thrust may change by in a second of burning, 1 sigma."""
JUMP = 4.0
"""A pressure this many sigma off means that something broke: what was known of the thrust is forgotten."""


@pytree
class ThrustGauge:
    """Estimate of the thrust over its nominal value.

    Attributes:
        ratio: () [-]
        variance: () [-]
    """

    ratio: Array
    variance: Array


def initial() -> ThrustGauge:
    """The thruster as calibrated."""
    return ThrustGauge(ratio=jnp.ones((), dtype=jnp.float64), variance=jnp.full((), CALIBRATION**2, dtype=jnp.float64))


def update(gauge: ThrustGauge, pressure: Scalar) -> ThrustGauge:
    """Estimate after a second of burning with the given mean pressure over its nominal value."""
    innovation = pressure - gauge.ratio
    prior = gauge.variance + CHANGE**2
    noise = PRESSURE_NOISE**2
    prior = jnp.where(innovation**2 > JUMP**2 * (prior + noise), 1.0, prior)
    gain = prior / (prior + noise)
    return ThrustGauge(ratio=gauge.ratio + gain * innovation, variance=(1.0 - gain) * prior)


def doubt(gauge: ThrustGauge) -> Scalar:
    """How much less certain the thrust is than by calibration alone, at least 1 [-]."""
    settled = 1.2 * CALIBRATION
    return jnp.maximum(jnp.sqrt(gauge.variance) / settled, 1.0)
