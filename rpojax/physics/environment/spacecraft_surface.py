"""Aerodynamic and optical properties of a vehicle's surface."""

from jaxtyping import Array

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree


@pytree
class Surface:
    """Surface of a vehicle for drag and solar radiation pressure: a sphere about the centre of pressure."""

    area: Array = number("mean cross-section", unit="m2", at_least=0.0)
    drag_coefficient: Array = number("coefficient of drag", at_least=0.0)
    pressure_coefficient: Array = number("coefficient of radiation pressure: 1 absorption, 2 reflection", at_least=0.0)
    center_of_pressure: Array = number("from the centre of mass, B or T; gives the torque", unit="m", length=3)
