"""Radial and tangential distortion of a lens, after Brown and Conrady (Brown, Photogrammetric Engineering, 1966)."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

_STEPS = 8
"""Steps of Newton's method: from the distorted place itself, rounding is reached within the frame of a usual lens."""
_FARTHEST = 1.5
"""Tangent up to which the polynomial of a lens is used: 56 deg from the boresight."""
_RADII = np.linspace(0.0, _FARTHEST, 97)
"""Tangents at which a lens is tried."""
_LEAST_SLOPE = 0.1
"""Derivative of the shown radius by the true one below which the image of a lens is taken as folded."""
_TINY = 1e-12


def distort(coefficients: Float[Array, "5"] | None, x: Array, y: Array) -> tuple[Array, Array]:
    """Tangents right and down of the boresight as a lens shows them, of those of a pinhole; the same without a lens.

    The coefficients are k1, k2, p1, p2, k3 in the order and with the signs of OpenCV: three radial ones of the second,
    fourth and sixth power of the tangent, two tangential ones. Beyond the radius where the polynomial would fold the
    image back, a place goes on straight out, so that what is outside of the frame stays there.
    """
    if coefficients is None:
        return x, y
    numbers = coefficients.astype(x.dtype)
    excess = jnp.maximum(_radius(x, y) / _fold_radius(numbers), 1.0)
    shown_x, shown_y = _polynomial(numbers, x / excess, y / excess)
    return shown_x * excess, shown_y * excess


def undistort(coefficients: Float[Array, "5"] | None, x: Array, y: Array) -> tuple[Array, Array]:
    """Tangents of a pinhole of those that a lens shows: the inverse of `distort`, by Newton's method.

    Beyond the radius of `distort` it is so but for the tangential terms.
    """
    if coefficients is None:
        return x, y
    numbers = coefficients.astype(x.dtype)
    k1, k2, p1, p2, k3 = numbers
    excess = jnp.maximum(_radius(x, y) / largest_shown_radius(numbers), 1.0)
    shown_x, shown_y = x / excess, y / excess
    x, y = shown_x, shown_y
    for _ in range(_STEPS):
        found_x, found_y = _polynomial(numbers, x, y)
        error_x, error_y = found_x - shown_x, found_y - shown_y
        square = x * x + y * y
        radial, slope = _radial(numbers, square), 2.0 * (k1 + square * (2.0 * k2 + 3.0 * square * k3))
        xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        scale = 1.0 / jnp.maximum(xx * yy - xy * xy, _LEAST_SLOPE**2)
        x, y = x - scale * (yy * error_x - xy * error_y), y - scale * (xx * error_y - xy * error_x)
    return x * excess, y * excess


def largest_shown_radius(coefficients: Float[Array, "5"]) -> Float[Array, ""]:
    """Tangent from the boresight up to which a lens shows each direction at one place."""
    radius = _fold_radius(coefficients)
    return radius * _radial(coefficients, radius * radius)


def of_lens_in_use(
    own: Float[Array, "5"] | None, wide: Float[Array, "5"] | None, is_wide: Bool[Array, ""]
) -> Float[Array, "5"] | None:
    """Coefficients of the lens in use of two, None where neither distorts."""
    if own is None and wide is None:
        return None
    pinhole = jnp.zeros(5)
    return jnp.where(is_wide, pinhole if wide is None else wide, pinhole if own is None else own)


def _polynomial(coefficients: Array, x: Array, y: Array) -> tuple[Array, Array]:
    p1, p2 = coefficients[2], coefficients[3]
    square = x * x + y * y
    radial = _radial(coefficients, square)
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
        y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def _radial(coefficients: Array, square: Array) -> Array:
    """Factor of a radius, by its square."""
    k1, k2, k3 = coefficients[0], coefficients[1], coefficients[4]
    return 1.0 + square * (k1 + square * (k2 + square * k3))


def _radius(x: Array, y: Array) -> Array:
    return jnp.sqrt(x * x + y * y + _TINY)


def _fold_radius(coefficients: Array) -> Array:
    """Tangent from the boresight below which the shown radius grows with the true one."""
    k1, k2, _, _, k3 = jax.lax.stop_gradient(coefficients)
    radii = jnp.asarray(_RADII, coefficients.dtype)
    square = radii * radii
    slope = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + 7.0 * k3 * square))
    return jnp.min(jnp.where(slope < _LEAST_SLOPE, radii, _FARTHEST))
