"""Sine, cosine and arc tangent as power series, which XLA vectorises, unlike library calls."""

import math
from typing import Final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_TERMS = 14
_COSINE: Final = [(-1.0) ** k / math.factorial(2 * k) for k in range(_TERMS)]
_SINC: Final = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(_TERMS)]


def cos_sinc(square: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Cosine of x and sin(x)/x from x squared [rad^2], to 1e-15 for |x| up to pi."""
    cosine = jnp.full_like(square, _COSINE[-1])
    sinc = jnp.full_like(square, _SINC[-1])
    for c, s in zip(reversed(_COSINE[:-1]), reversed(_SINC[:-1]), strict=True):
        cosine = cosine * square + c
        sinc = sinc * square + s
    return cosine, sinc


def cos_sin(angle: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Cosine and sine of an angle [rad], to 1e-15 plus the rounding of the angle."""
    within = angle - 2.0 * math.pi * jnp.round(angle / (2.0 * math.pi))
    cosine, sinc = cos_sinc(within * within)
    return cosine, within * sinc


_ARCTAN: Final = [(-1.0) ** k / (2 * k + 1) for k in range(13)]
_REDUCTION_ANGLE: Final = math.pi / 8.0


@jax.custom_jvp
def arctan2(y: Float[Array, "*shape"], x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Angle [rad] of the point (x, y), to two roundings for numbers up to 1e150; value and derivative 0 at the origin.

    A negative zero counts as zero.
    """
    larger, smaller = jnp.maximum(jnp.abs(x), jnp.abs(y)), jnp.minimum(jnp.abs(x), jnp.abs(y))
    # The nearest of 0, 22.5 and 45 deg is subtracted, so that the tangent of the remainder is at most 0.2.
    multiple = jnp.where(smaller > math.tan(0.5 * _REDUCTION_ANGLE) * larger, 1.0, 0.0)
    multiple = jnp.where(smaller > math.tan(1.5 * _REDUCTION_ANGLE) * larger, 2.0, multiple)
    multiple_tangent = jnp.where(multiple > 1.5, 1.0, math.tan(_REDUCTION_ANGLE) * multiple)
    denominator = larger + multiple_tangent * smaller
    tangent = (smaller - multiple_tangent * larger) / jnp.where(denominator > 0.0, denominator, 1.0)
    square = tangent * tangent
    series = jnp.full_like(square, _ARCTAN[-1])
    for term in reversed(_ARCTAN[:-1]):
        series = series * square + term
    angle = multiple * _REDUCTION_ANGLE + tangent * series
    angle = jnp.where(jnp.abs(y) > jnp.abs(x), 0.5 * math.pi - angle, angle)
    angle = jnp.where(x < 0.0, math.pi - angle, angle)
    return jnp.where(y < 0.0, -angle, angle)


@arctan2.defjvp
def _arctan2_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    y, x = primals
    square = x * x + y * y
    nonzero = square != 0.0
    slope = (x * tangents[0] - y * tangents[1]) / jnp.where(nonzero, square, 1.0)
    return arctan2(y, x), jnp.where(nonzero, slope, 0.0)
