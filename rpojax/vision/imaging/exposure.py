"""What a camera's detector makes of radiance: blur, exposure, shot and read noise, saturation."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Image = Float[Array, "h w 3"]
Scalar = Float[Array, ""]

_REACH = 3


@pytree
class Exposure:
    """How a detector turns radiance into grey values.

    Attributes:
        gain: () exposure, 1 = white level of the field at full well
        full_well: () electrons at saturation
        read_noise: () 1 sigma [electrons]
        blur: () sigma of the point spread [px]
    """

    gain: Array
    full_well: Array
    read_noise: Array
    blur: Array


def expose(image: Image, exposure: Exposure, noise: Image, binning: Scalar | float = 1.0) -> Image:
    """Linear values (0 to 1, saturated) of a linear picture; `noise` are standard normal numbers.

    `binning` is how many of the detector's pixels are averaged along each side of one of the picture's.
    """
    gain, well, read = (value.astype(jnp.float32) for value in (exposure.gain, exposure.full_well, exposure.read_noise))
    electrons = jnp.maximum(_blur(image, exposure.blur.astype(jnp.float32) / binning), 0.0) * (gain * well)
    # Shot noise of so many electrons is normal enough, and the sum of two normal numbers is one.
    # A pixel without light or noise still has a slope.
    sigma = jnp.sqrt(jnp.maximum(electrons + read * read, 1e-6)) / binning
    return jnp.clip((electrons + sigma * noise) / well, 0.0, 1.0)


def _blur(image: Image, sigma: Scalar) -> Image:
    """Gaussian blur over 7 x 7 pixels, 3 sigma of the widest; beyond the frame it is as at its edge."""
    offset = jnp.arange(-_REACH, _REACH + 1, dtype=jnp.float32)
    kernel = jnp.exp(-0.5 * (offset / jnp.maximum(sigma, 1e-3)) ** 2)
    kernel = kernel / jnp.sum(kernel)
    height, width = image.shape[:2]
    padded = jnp.pad(image, ((_REACH, _REACH), (0, 0), (0, 0)), mode="edge")
    down = sum((kernel[i] * padded[i : i + height] for i in range(len(offset))), jnp.zeros_like(image))
    padded = jnp.pad(down, ((0, 0), (_REACH, _REACH), (0, 0)), mode="edge")
    return sum((kernel[i] * padded[:, i : i + width] for i in range(len(offset))), jnp.zeros_like(image))
