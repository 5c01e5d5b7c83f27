"""Closest approach between two times at which relative position and velocity are known, by Hermite interpolation."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

_NEWTON_STEPS: Final = 3


@pytree
class Approach:
    """Relative motion over an interval, with its closest approach.

    Attributes:
        r: (2, 3) relative position at both ends [m]
        slope: (2, 3) relative velocity at both ends times the length of the interval [m]
        place: () of the closest approach, as a fraction of the interval; an end if it recedes or approaches throughout
        square: () squared distance there [m^2]
    """

    r: Array
    slope: Array
    place: Array
    square: Array


def closest_approach(r: Float[Array, "2 3"], v: Float[Array, "2 3"], duration: Scalar | float) -> Approach:
    """Closest approach from positions [m] and velocities [m/s] at both ends of an interval of `duration` [s].

    For intervals short enough for one extremum of the distance.
    """
    slope = v * duration
    rates = jnp.sum(r * slope, axis=1)
    inside = (rates[0] < 0.0) & (rates[1] > 0.0)
    place = jnp.where(inside, rates[0] / jnp.where(inside, rates[0] - rates[1], 1.0), 0.0)
    for _ in range(_NEWTON_STEPS):
        p, dp, ddp = _hermite(r, slope, place)
        rate, growth = jnp.sum(p * dp, axis=0), jnp.sum(dp * dp + p * ddp, axis=0)
        step = jnp.where(growth > 0.0, rate / jnp.where(growth > 0.0, growth, 1.0), 0.0)
        place = jnp.where(inside, jnp.clip(place - step, 0.0, 1.0), place)
    squares = jnp.sum(r * r, axis=1)
    square = jnp.sum(jnp.square(_hermite(r, slope, place)[0]), axis=0)
    at_end = squares[1] < jnp.minimum(squares[0], square)
    place = jnp.where(at_end, 1.0, jnp.where(squares[0] < square, 0.0, place))
    return Approach(r=r, slope=slope, place=place, square=jnp.minimum(square, jnp.min(squares, axis=0)))


def least_square_until(approach: Approach, end: Scalar) -> Scalar:
    """Least squared distance [m^2] from the beginning of the interval to a fraction `end` of it."""
    whole = approach.place <= end
    at_begin = jnp.sum(jnp.square(approach.r[0]), axis=0)
    at_end = jnp.sum(jnp.square(_hermite(approach.r, approach.slope, end)[0]), axis=0)
    return jnp.where(whole, approach.square, jnp.minimum(at_begin, at_end))


def entry_place(approach: Approach, radius: Scalar) -> Scalar:
    """Where the distance falls below `radius` [m], as a fraction of the interval; infinite if it does not.

    By the parabola through the squared distance at the beginning and its minimum.
    """
    begin, least = jnp.sum(jnp.square(approach.r[0]), axis=0), approach.square
    depth = begin - least
    share = jnp.sqrt(jnp.clip((radius * radius - least) / jnp.where(depth > 0.0, depth, 1.0), 0.0, 1.0))
    return jnp.where(least < radius * radius, approach.place * (1.0 - share), jnp.inf)


def _hermite(r: Float[Array, "2 3"], slope: Float[Array, "2 3"], x: Scalar) -> tuple[Vector, Vector, Vector]:
    """Position and its first two derivatives at a fraction `x` of the interval."""
    chord = r[1] - r[0]
    quadratic = 3.0 * chord - 2.0 * slope[0] - slope[1]
    cubic = slope[0] + slope[1] - 2.0 * chord
    position = r[0] + x * (slope[0] + x * (quadratic + x * cubic))
    return position, slope[0] + x * (2.0 * quadratic + 3.0 * x * cubic), 2.0 * quadratic + 6.0 * x * cubic
