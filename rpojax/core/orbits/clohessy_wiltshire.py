"""Relative motion near a circular orbit in the Hill frame.

Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


def transition_matrix(n: Scalar, t: Scalar) -> Float[Array, "6 6"]:
    """State transition matrix of (rho, rho_dot) in the Hill frame over `t` [s] at mean motion `n` [rad/s]."""
    angle = n * t
    s, c = jnp.sin(angle), jnp.cos(angle)
    zero, one = jnp.zeros_like(s), jnp.ones_like(s)
    rows = [
        [4 - 3 * c, zero, zero, s / n, 2 / n * (1 - c), zero],
        [6 * (s - angle), one, zero, -2 / n * (1 - c), (4 * s - 3 * angle) / n, zero],
        [zero, zero, c, zero, zero, s / n],
        [3 * n * s, zero, zero, c, 2 * s, zero],
        [-6 * n * (1 - c), zero, zero, -2 * s, 4 * c - 3, zero],
        [zero, zero, -n * s, zero, zero, c],
    ]
    return jnp.stack([jnp.stack(row) for row in rows])
