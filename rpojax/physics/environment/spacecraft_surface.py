"""Aerodynamic and optical properties of a vehicle's surface."""

from jaxtyping import Array

from rpojax.core.pytree import pytree


@pytree
class Surface:
    """Surface of a vehicle for drag and solar radiation pressure: a sphere about the centre of pressure.

    Attributes:
        area: () [m^2]
        drag_coefficient: () [-]
        pressure_coefficient: () of sunlight, 1 absorbs, 2 reflects all [-]
        center_of_pressure: (3,) from the centre of mass, body axes [m]
    """

    area: Array
    drag_coefficient: Array
    pressure_coefficient: Array
    center_of_pressure: Array
