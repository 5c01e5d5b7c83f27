"""Positions of the Sun and the Moon at one time."""

from jaxtyping import Array

from rpojax.core.pytree import pytree


@pytree
class SunMoonPositions:
    """Positions of the Sun and the Moon from the Earth's centre.

    Attributes:
        sun_N: (3,) [m]
        moon_N: (3,) [m]
    """

    sun_N: Array
    moon_N: Array
