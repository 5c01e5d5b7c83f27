"""Gravity of the Sun and the Moon: on the target, and as felt between two craft."""

from jaxtyping import Array, Float

from rpojax.core.difference import Difference, inverse_length

Vector = Float[Array, "3"]


def distant(mu: float, r_body_N: Vector, r: Difference) -> Difference:
    """Pull [m/s^2] of a distant body at `r_body_N` [m], less its pull on the Earth, at an inertial position [m].

    The pull at the position less that at the Earth's centre is itself a difference, over the position vector.
    """
    from_earth = _point_mass(mu, Difference(value=-r_body_N, change=r.value))
    between = _point_mass(mu, Difference(value=r.value - r_body_N, change=r.change))
    return Difference(value=from_earth.change, change=between.change)


def _point_mass(mu: float, d: Difference) -> Difference:
    inverse = inverse_length(d)
    return (inverse * inverse * inverse * -mu).scale(d)
