"""Pressure sensor in the thruster's chamber, from which flight software estimates the thrust."""

from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class ChamberPressure:
    """Errors of the pressure sensor."""

    noise: Array = number(
        "white noise as a fraction of the pressure, 1 sigma; while no pulse is commanded, of the nominal pressure",
        at_least=0.0,
        default=0.03,
    )


def measure(sensor: ChamberPressure, thrust_ratio: Scalar, normal: Scalar) -> Scalar:
    """Measured ratio of the thrust to its nominal value while the valve is open [-]."""
    return thrust_ratio * (1.0 + sensor.noise * normal)


def measure_at_rest(
    sensor: ChamberPressure, thrust_ratio: Float[Array, " n"], normals: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Measured ratio of the pressure to its nominal value while no pulse is commanded: zero of a sound thruster [-]."""
    return thrust_ratio + sensor.noise * normals
