"""Numbers of a dispersion at a point of the unit cube, by inverse distribution functions: designs choose the points."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array, Float

UNIT_MARGIN = 2.0**-53
"""Least distance of a coordinate from 0 and 1, where inverse distributions are infinite."""


def clip_to_open_interval(coordinates: np.ndarray) -> np.ndarray:
    """Coordinates clipped to the open interval (0, 1)."""
    return np.clip(coordinates, UNIT_MARGIN, 1.0 - UNIT_MARGIN)


@dataclass(frozen=True)
class CoordinateSource:
    """Numbers from a point of the unit cube by inverse distribution functions.

    Attributes:
        coordinates: (n,) in (0, 1), as many as the dispersion's `coordinate_count`
    """

    coordinates: Float[Array, " n"]

    def normals(self, shape: tuple[int, ...]) -> Array:
        """Standard normal numbers."""
        return ndtri(self.coordinates).reshape(shape)

    def uniforms(self, shape: tuple[int, ...]) -> Array:
        """Numbers uniform in (0, 1)."""
        return self.coordinates.reshape(shape)

    def integer(self, count: int) -> Array:
        """Integer uniform in [0, count)."""
        return jnp.minimum(jnp.floor(self.coordinates[0] * count).astype(jnp.int32), count - 1)

    def direction(self) -> Float[Array, "3"]:
        """Unit vector uniform on the sphere, from uniform z and azimuth."""
        z, azimuth = 2.0 * self.coordinates[0] - 1.0, 2.0 * math.pi * self.coordinates[1]
        across = jnp.sqrt((1.0 - z) * (1.0 + z))
        return jnp.stack([across * jnp.cos(azimuth), across * jnp.sin(azimuth), z])

    def attitude(self) -> Float[Array, "4"]:
        """Unit quaternion uniform over all attitudes (Shoemake, "Uniform random rotations", Graphics Gems III)."""
        first, second = 2.0 * math.pi * self.coordinates[1], 2.0 * math.pi * self.coordinates[2]
        short, long = jnp.sqrt(1.0 - self.coordinates[0]), jnp.sqrt(self.coordinates[0])
        return jnp.stack(
            [short * jnp.sin(first), short * jnp.cos(first), long * jnp.sin(second), long * jnp.cos(second)]
        )
