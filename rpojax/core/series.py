"""Sine and cosine as power series: vectorised, branch-free and smooth at zero, unlike library calls."""

import math
from typing import Final

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
