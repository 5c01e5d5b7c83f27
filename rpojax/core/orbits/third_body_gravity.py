"""Gravity of the Sun and the Moon as a perturbation of an orbit about the Earth."""

from jaxtyping import Array, Float

from rpojax.core.numerics.exact_difference import Difference, inverse_norm

Vector = Float[Array, "3"]


def third_body_acceleration(mu: float, r_body_N: Vector, r: Difference) -> Difference:
    """Acceleration [m/s^2] by a body at `r_body_N` [m], less that of the Earth, at an inertial position [m].

    The acceleration at the position less that of the Earth's centre is itself a `Difference` over the position vector.
    """
    from_earth = _point_mass(mu, Difference(value=-r_body_N, change=r.value))
    between = _point_mass(mu, Difference(value=r.value - r_body_N, change=r.change))
    return Difference(value=from_earth.change, change=between.change)


def _point_mass(mu: float, d: Difference) -> Difference:
    inverse = inverse_norm(d)
    return (inverse * inverse * inverse * -mu).scale(d)
