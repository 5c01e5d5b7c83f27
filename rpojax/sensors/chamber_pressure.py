"""Pressure sensor in the thruster's chamber, from which flight software estimates the thrust."""

from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class ChamberPressure:
    """Errors of the pressure sensor.

    Attributes:
        noise: () white noise, 1 sigma, as a fraction of the measured pressure [-]
    """

    noise: Array


def measure(sensor: ChamberPressure, thrust_ratio: Scalar, normal: Scalar) -> Scalar:
    """Measured ratio of the thrust to its nominal value while the valve is open [-]."""
    return thrust_ratio * (1.0 + sensor.noise * normal)
