"""Convolution layer of both networks of the detector."""

import jax.numpy as jnp
from flax import linen


def convolution(name: str, width: int, stride: int = 1, size: int = 3, padding: int | None = None) -> linen.Conv:
    """Square convolution in float32 to `width` channels; by default the output is as large as the input over stride."""
    zero_padding = size // 2 if padding is None else padding
    return linen.Conv(
        width,
        (size, size),
        (stride, stride),
        padding=((zero_padding, zero_padding), (zero_padding, zero_padding)),
        name=name,
        param_dtype=jnp.float32,
        kernel_init=linen.initializers.he_normal(),
    )
