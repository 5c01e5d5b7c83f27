"""Convolution layers of both networks of the detector."""

import jax.numpy as jnp
from flax import linen


def convolution(name: str, width: int, stride: int = 1, size: int = 3, scale: float = 1.0) -> linen.Conv:
    """Square convolution in float32 to `width` channels; the output is as large as the input over stride.

    `scale` is that of the untrained kernel.
    """
    zero_padding = size // 2
    return linen.Conv(
        width,
        (size, size),
        (stride, stride),
        padding=((zero_padding, zero_padding), (zero_padding, zero_padding)),
        name=name,
        param_dtype=jnp.float32,
        kernel_init=linen.initializers.variance_scaling(2.0 * scale**2, "fan_in", "truncated_normal"),
    )


def output_layer(name: str, width: int) -> linen.Conv:
    """Convolution of size 1 from features to results; untrained ones are near 0."""
    return linen.Conv(
        width, (1, 1), name=name, param_dtype=jnp.float32, kernel_init=linen.initializers.normal(0.02, jnp.float32)
    )
