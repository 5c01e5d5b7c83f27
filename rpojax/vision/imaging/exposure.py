"""Exposure of an image sensor: blur, bloom, smear, gain, shot and read noise, saturation."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Image = Float[Array, "h w 3"]
Scalar = Float[Array, ""]

_KERNEL_RADIUS_PX = 3
_SMEAR_PLACES = 16
"""Places of Gauss and Legendre along a smear, so that its moments are exact."""
_LONGEST_SMEAR_SIGMA = 13.0
"""Smear by the sigma of the blur up to which these places make an even line; a longer one widens the blur."""
_LEAST_SMEAR_SIGMA_PX = 0.3


@pytree
class Exposure:
    """Parameters of an exposure.

    Attributes:
        gain: () exposure, 1 = white level of the field at full well
        full_well: () electrons at saturation
        read_noise: () 1 sigma [electrons]
        blur: () sigma of the point spread function [px]
        bloom: () fraction of the light that the optics scatter into a halo, None without one
        bloom_radius: () sigma of the halo [px]
    """

    gain: Array
    full_well: Array
    read_noise: Array
    blur: Array
    bloom: Array | None = None
    bloom_radius: Array | None = None


def expose(
    image: Image,
    exposure: Exposure,
    noise: Image,
    binning: Scalar | float = 1.0,
    smear_px: Float[Array, "2"] | None = None,
) -> Image:
    """Linear values in 0..1, saturated, of a linear image; `noise` are standard normal numbers.

    A pixel of the image is the mean of `binning` x `binning` pixels of the sensor. `smear_px` is the way right and down
    of the image during the exposure, in its pixels, None for one at rest.
    """
    gain, well, read = (value.astype(jnp.float32) for value in (exposure.gain, exposure.full_well, exposure.read_noise))
    radiance = through_optics(image, exposure, binning, smear_px)
    electrons = jnp.maximum(radiance, 0.0) * (gain * well)
    # Shot noise (normal approximation) and read noise; the floor keeps the gradient of a dark pixel finite.
    sigma = jnp.sqrt(jnp.maximum(electrons + read * read, 1e-6)) / binning
    return jnp.clip((electrons + sigma * noise) / well, 0.0, 1.0)


def through_optics(
    image: Image, exposure: Exposure, binning: Scalar | float = 1.0, smear_px: Float[Array, "2"] | None = None
) -> Image:
    """A linear image after blur, smear and bloom of the optics."""
    sigma = exposure.blur.astype(jnp.float32) / binning
    sharp = _blur(image, sigma) if smear_px is None else _blur_along(image, sigma, smear_px)
    if exposure.bloom is None or exposure.bloom_radius is None:
        return sharp
    bloom, radius = (value.astype(jnp.float32) for value in (exposure.bloom, exposure.bloom_radius))
    down, across = (_gaussian(size, jnp.zeros(()), radius / binning) for size in image.shape[:2])
    return (1.0 - bloom) * sharp + bloom * _filtered(image, down, across)


def _blur_along(image: Image, sigma: Scalar, smear: Float[Array, "2"]) -> Image:
    """Gaussian blur of an image that moves by `smear` [px], right and down, about its place in the middle.

    A sum of 16 Gaussians along the way, of at least 0.3 px, and so wide that they make a line: of a smear of more than
    13 sigma the blur is wider than it is.
    """
    places, weights = np.polynomial.legendre.leggauss(_SMEAR_PLACES)
    length = jnp.sqrt(jnp.sum(smear.astype(jnp.float32) ** 2) + 1e-12)
    sigma = jnp.maximum(jnp.maximum(sigma, _LEAST_SMEAR_SIGMA_PX), length / _LONGEST_SMEAR_SIGMA)
    found = jnp.zeros_like(image)
    for place, weight in zip(0.5 * places, 0.5 * weights, strict=True):
        across, down = (
            _gaussian(size, np.float32(place) * shift, sigma)
            for size, shift in zip((image.shape[1], image.shape[0]), smear.astype(jnp.float32), strict=True)
        )
        found = found + np.float32(weight) * _filtered(image, down, across)
    return found


def _filtered(image: Image, down: Float[Array, "h h"], across: Float[Array, "w w"]) -> Image:
    return jnp.einsum("hr,rsc,ws->hwc", down, image, across)


def _gaussian(size: int, shift: Scalar, sigma: Scalar) -> Float[Array, "n n"]:
    """Weights (n, n) by which each pixel of a row gets light of the others, as if the row went on beyond its ends."""
    pixel = jnp.arange(size, dtype=jnp.float32)
    offset = pixel[:, None] - pixel[None, :] - shift.astype(jnp.float32)
    weight = jnp.exp(-0.5 * (offset / sigma) ** 2)
    return weight / jnp.sum(weight, axis=1, keepdims=True)


def _blur(image: Image, sigma: Scalar) -> Image:
    """Gaussian blur over 7 x 7 pixels, with edge padding."""
    offset = jnp.arange(-_KERNEL_RADIUS_PX, _KERNEL_RADIUS_PX + 1, dtype=jnp.float32)
    kernel = jnp.exp(-0.5 * (offset / jnp.maximum(sigma, 1e-3)) ** 2)
    kernel = kernel / jnp.sum(kernel)
    height, width = image.shape[:2]
    padded = jnp.pad(image, ((_KERNEL_RADIUS_PX, _KERNEL_RADIUS_PX), (0, 0), (0, 0)), mode="edge")
    down = sum((kernel[i] * padded[i : i + height] for i in range(len(offset))), jnp.zeros_like(image))
    padded = jnp.pad(down, ((0, 0), (_KERNEL_RADIUS_PX, _KERNEL_RADIUS_PX), (0, 0)), mode="edge")
    return sum((kernel[i] * padded[:, i : i + width] for i in range(len(offset))), jnp.zeros_like(image))
