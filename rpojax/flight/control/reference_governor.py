"""Reference governor: a station nearer to the vehicle while the way to the station would ask too much of the thruster.

A linear controller that saturates goes too far: its velocity feedback, which would brake, is scaled down with the rest.
Instead the along-track deviation is reduced until the command is within the limit (Bemporad, IEEE Transactions on
Automatic Control 43, 1998). Every point along-track is an equilibrium of the relative motion in a circular orbit; an
intermediate point off it would take thrust to hold.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def govern(gain: Float[Array, "3 6"], deviation: Float[Array, "6"], offset: Vector, limit: Scalar) -> Float[Array, "6"]:
    """Deviation [m, m/s] with as much of its along-track position as keeps the velocity change within `limit` [m/s].

    `offset` [m/s] is added to the feedback. If the other components alone need more, the share that helps most is used.
    """
    along = -gain[:, 1] * deviation[1]
    rest = offset - jnp.sum(gain * deviation[None, :], axis=1) - along
    a, b, c = jnp.sum(along**2, axis=0), jnp.sum(along * rest, axis=0), jnp.sum(rest**2, axis=0) - limit**2
    some = a > LEAST_DELTA_V**2
    share = (gradient_safe.sqrt(jnp.maximum(b * b - a * c, 0.0)) - b) / jnp.where(some, a, 1.0)
    share = jnp.where(some, jnp.clip(share, 0.0, 1.0), 1.0)
    return jnp.concatenate([deviation[:1], share * deviation[1:2], deviation[2:]])


LEAST_DELTA_V = 1e-12
"""Velocity change that is none [m/s]: a billionth of the smallest burns, which are of mm/s."""
