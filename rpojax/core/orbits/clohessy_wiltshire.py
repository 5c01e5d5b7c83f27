"""Relative motion near a circular orbit in the Hill frame.

Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def transition_matrix(n: Scalar, t: Scalar) -> Float[Array, "6 6"]:
    """State transition matrix of (rho, rho_dot) in the Hill frame over `t` [s] at mean motion `n` [rad/s]."""
    angle = n * t
    return _transition_over_angle(n, angle, jnp.sin(angle), jnp.cos(angle))


def _transition_over_angle(n: Scalar, angle: Scalar, s: Scalar, c: Scalar) -> Float[Array, "6 6"]:
    """`transition_matrix` over an `angle` of the orbit [rad] with sine `s` and cosine `c`."""
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


def minimum_drift_distance(n: Scalar, rho_H: Vector, rho_dot_H: Vector) -> Scalar:
    """Least distance [m] over one orbit of unforced relative motion from a state [m, m/s] in the Hill frame.

    Evaluated every five degrees of the orbit, at mean motion `n` [rad/s].
    """
    angle = np.radians(np.arange(0.0, 361.0, 5.0))
    state = jnp.concatenate([rho_H, rho_dot_H])
    transitions = jax.vmap(_transition_over_angle, in_axes=(None, 0, 0, 0))(
        n, *map(jnp.asarray, (angle, np.sin(angle), np.cos(angle)))
    )
    rho = jnp.sum(transitions[:, :3] * state[None, None, :], axis=2)
    return jnp.sqrt(jnp.min(jnp.sum(rho * rho, axis=1), axis=0))
