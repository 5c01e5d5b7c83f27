"""Pressure sensor in the thruster's chamber, from which flight software estimates the thrust."""

from jaxtyping import Array, Float

Scalar = Float[Array, ""]

NOISE_SIGMA = 0.03
"""Error of the ratio, 1 sigma [-]."""


def measure(thrust_ratio: Scalar, normal: Scalar) -> Scalar:
    """Measured ratio of the thrust to its nominal value while the valve is open [-]."""
    return thrust_ratio * (1.0 + NOISE_SIGMA * normal)
