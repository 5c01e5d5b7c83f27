"""Closest approach between two times at which relative position and velocity are known, by Hermite interpolation."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]

_NEWTON_STEPS: Final = 3


@pytree
class Approach:
    """Relative motion over an interval, with its closest approach.

    Attributes:
        squares: (7,) coefficients of the squared distance [m^2] as a polynomial in the fraction of the interval
        place: () of the closest approach, as a fraction of the interval; an end if it recedes or approaches throughout
        least: () squared distance there [m^2]
    """

    squares: Array
    place: Array
    least: Array


def closest_approach(r: Float[Array, "2 3"], v: Float[Array, "2 3"], duration: Scalar | float) -> Approach:
    """Closest approach from positions [m] and velocities [m/s] at both ends of an interval of `duration` [s].

    For intervals short enough for one extremum of the distance.
    """
    squares = _squared_distance(r, v * duration)
    rates = [squares[1], sum(k * squares[k] for k in range(1, 7))]
    inside = (rates[0] < 0.0) & (rates[1] > 0.0)
    place = jnp.where(inside, rates[0] / jnp.where(inside, rates[0] - rates[1], 1.0), 0.0)
    slopes = [k * squares[k] for k in range(1, 7)]
    curvatures = [k * slopes[k] for k in range(1, 6)]
    for _ in range(_NEWTON_STEPS):
        curvature = _polynomial(curvatures, place)
        step = _polynomial(slopes, place) / jnp.where(curvature > 0.0, curvature, 1.0)
        place = jnp.where(inside & (curvature > 0.0), jnp.clip(place - step, 0.0, 1.0), place)
    begin, end = squares[0], jnp.sum(jnp.square(r[1]), axis=0)
    within = jnp.maximum(_polynomial(squares, place), 0.0)
    least = jnp.minimum(within, jnp.minimum(begin, end))
    place = jnp.where(within <= least, place, jnp.where(begin <= end, 0.0, 1.0))
    return Approach(squares=jnp.stack(squares), place=place, least=least)


def least_square_until(approach: Approach, end: Scalar) -> Scalar:
    """Least squared distance [m^2] from the beginning of the interval to a fraction `end` of it."""
    begin, here = approach.squares[0], jnp.maximum(_polynomial(list(approach.squares), end), 0.0)
    return jnp.where(approach.place <= end, approach.least, jnp.minimum(begin, here))


def entry_place(approach: Approach, radius: Scalar) -> Scalar:
    """Where the distance falls below `radius` [m], as a fraction of the interval; infinite if it does not.

    From the parabola through the squared distance at the beginning and its minimum by Newton's method.
    """
    square, squares = radius * radius, list(approach.squares)
    depth = squares[0] - approach.least
    share = jnp.sqrt(jnp.clip((square - approach.least) / jnp.where(depth > 0.0, depth, 1.0), 0.0, 1.0))
    place = approach.place * (1.0 - share)
    slopes = [k * squares[k] for k in range(1, 7)]
    for _ in range(_NEWTON_STEPS):
        slope = _polynomial(slopes, place)
        step = (_polynomial(squares, place) - square) / jnp.where(slope < 0.0, slope, -jnp.inf)
        place = jnp.clip(place - step, 0.0, approach.place)
    return jnp.where(approach.least < square, place, jnp.inf)


def _squared_distance(r: Float[Array, "2 3"], slope: Float[Array, "2 3"]) -> list[Scalar]:
    """Coefficients of the squared norm of the cubic with positions `r` and derivatives `slope` at both ends."""
    chord = r[1] - r[0]
    terms = (r[0], slope[0], 3.0 * chord - 2.0 * slope[0] - slope[1], slope[0] + slope[1] - 2.0 * chord)
    coefficients: list[Scalar] = [jnp.zeros_like(r[0, 0])] * 7
    for i, one in enumerate(terms):
        for j in range(i, 4):
            product = jnp.sum(one * terms[j], axis=0)
            coefficients[i + j] = coefficients[i + j] + (product if i == j else 2.0 * product)
    return coefficients


def _polynomial(coefficients: list[Scalar], x: Scalar) -> Scalar:
    """Value of a polynomial by Horner's rule."""
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = value * x + coefficient
    return value
