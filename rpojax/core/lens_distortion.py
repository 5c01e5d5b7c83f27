"""Radial and tangential distortion of a lens, after Brown and Conrady (Brown, Photogrammetric Engineering, 1966)."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_STEPS = 6
"""Steps of Newton's method: from the distorted place itself, rounding is reached within the frame of a usual lens."""
_FOLD = 0.05
"""Determinant of the derivative below which an image is taken as folded."""


def distort(coefficients: Float[Array, "5"], tangents: Float[Array, "2 ..."]) -> Float[Array, "2 ..."]:
    """Tangents right and down of the boresight as a lens shows them, of those of a pinhole.

    The coefficients are k1, k2, p1, p2, k3 in the order and with the signs of OpenCV: three radial ones of the second,
    fourth and sixth power of the tangent, two tangential ones.
    """
    k1, k2, p1, p2, k3 = (coefficients[i].astype(tangents.dtype) for i in range(5))
    x, y = tangents[0], tangents[1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    return jnp.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    )


def undistort(coefficients: Float[Array, "5"], tangents: Float[Array, "2 ..."]) -> Float[Array, "2 ..."]:
    """Tangents of a pinhole of those that a lens shows: the inverse of `distort`, by Newton's method."""
    k1, k2, p1, p2, k3 = (coefficients[i].astype(tangents.dtype) for i in range(5))
    found = tangents
    for _ in range(_STEPS):
        x, y = found[0], found[1]
        error_x, error_y = distort(coefficients, found) - tangents
        square = x * x + y * y
        radial = 1.0 + square * (k1 + square * (k2 + square * k3))
        slope = 2.0 * (k1 + square * (2.0 * k2 + 3.0 * square * k3))
        xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        determinant = xx * yy - xy * xy
        # Beyond the place where a lens folds its image there is no inverse; a step of Newton would leave the frame.
        scale = 1.0 / jnp.where(determinant > _FOLD, determinant, 1.0)
        found = found - jnp.stack([scale * (yy * error_x - xy * error_y), scale * (xx * error_y - xy * error_x)])
    return found


def corrected(coefficients: Float[Array, "5"] | None, tangents: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
    """Tangents (n, 2) of a picture corrected for a lens; as they are for None, a pinhole."""
    return tangents if coefficients is None else undistort(coefficients, tangents.T).T


def of_lens_in_use(
    own: Float[Array, "5"] | None, wide: Float[Array, "5"] | None, is_wide: Bool[Array, ""]
) -> Float[Array, "5"] | None:
    """Coefficients of the lens in use of two, None where neither distorts."""
    if own is None and wide is None:
        return None
    pinhole = jnp.zeros(5)
    return jnp.where(is_wide, pinhole if wide is None else wide, pinhole if own is None else own)
