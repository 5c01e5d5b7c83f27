"""Map of the directions in the target's Hill frame from which a team has seen the target in sunlight.

Flight software does not know the attitude of an uncooperative target. So it can only tell from which sides it was
seen, in a frame that it knows. If the target tumbles, another part of it turns to that side, so a view loses its
value with time.
"""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics.fibonacci_sphere import fibonacci_sphere
from rpojax.flight.team_guidance.team_situation import TeamTuning

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]

COUNT: Final = 100
"""Number of directions. A choice: neighbours are 18 to 20 deg apart."""


DIRECTIONS: Final = fibonacci_sphere(COUNT)
"""Normals of the sides of the target in H (3, directions)."""


def unseen(time: Scalar) -> Float[Array, " directions"]:
    """Map before anything was seen."""
    return jnp.stack([time - jnp.inf] * COUNT)


def is_seen(
    tuning: TeamTuning, place_H: Float[Array, "3 n"], sun_H: Float[Array, "3 n"]
) -> Bool[Array, "directions n"]:
    """Sides that are seen in sunlight from places [m], with the Sun in these directions."""
    normals = jnp.asarray(DIRECTIONS, dtype=place_H.dtype)
    towards = jnp.sum(normals[:, :, None] * place_H[:, None], axis=0)
    lit = jnp.sum(normals[:, :, None] * sun_H[:, None], axis=0)
    distance = jnp.sqrt(jnp.sum(place_H * place_H, axis=0))
    sun_distance = jnp.sqrt(jnp.sum(sun_H * sun_H, axis=0))
    near = towards >= jnp.cos(tuning.view_incidence) * distance[None]
    return near & (lit >= jnp.cos(tuning.view_sun_incidence) * sun_distance[None])


def seen_by_any(
    tuning: TeamTuning, places_H: Float[Array, "3 n"], sees: Bool[Array, " n"], sun_H: Vector
) -> Bool[Array, " directions"]:
    """Sides seen from the places [m] of the servicers for which `sees` is true."""
    suns_H = jnp.broadcast_to(sun_H[:, None], places_H.shape)
    return jnp.any(is_seen(tuning, places_H, suns_H) & sees[None], axis=1)


def worth(tuning: TeamTuning, last_seen: Float[Array, " directions"], time: Scalar) -> Float[Array, " directions"]:
    """What it is worth to see each side at `time` [s]: 1 if it was never seen, 0 if it is seen now."""
    return 1.0 - jnp.exp(-(time - last_seen) / tuning.view_memory)
