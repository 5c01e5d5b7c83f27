"""Exposure of an image sensor: blur, gain, shot and read noise, saturation."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Image = Float[Array, "h w 3"]
Scalar = Float[Array, ""]

_KERNEL_RADIUS_PX = 3


@pytree
class Exposure:
    """Parameters of an exposure.

    Attributes:
        gain: () exposure, 1 = white level of the field at full well
        full_well: () electrons at saturation
        read_noise: () 1 sigma [electrons]
        blur: () sigma of the point spread function [px]
    """

    gain: Array
    full_well: Array
    read_noise: Array
    blur: Array


def expose(image: Image, exposure: Exposure, noise: Image, binning: Scalar | float = 1.0) -> Image:
    """Linear values in 0..1, saturated, of a linear image; `noise` are standard normal numbers.

    A pixel of the image is the mean of `binning` x `binning` pixels of the sensor.
    """
    gain, well, read = (value.astype(jnp.float32) for value in (exposure.gain, exposure.full_well, exposure.read_noise))
    electrons = jnp.maximum(_blur(image, exposure.blur.astype(jnp.float32) / binning), 0.0) * (gain * well)
    # Shot noise (normal approximation) and read noise; the floor keeps the gradient of a dark pixel finite.
    sigma = jnp.sqrt(jnp.maximum(electrons + read * read, 1e-6)) / binning
    return jnp.clip((electrons + sigma * noise) / well, 0.0, 1.0)


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
