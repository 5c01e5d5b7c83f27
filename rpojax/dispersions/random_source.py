"""Sources of the random numbers behind a dispersion: a random key, or coordinates of a design in the unit cube."""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.random_streams import Key

UNIT_MARGIN = 2.0**-53
"""Least distance of a coordinate from 0 and 1, where inverse distributions are infinite."""


def clip_to_open_interval(coordinates: np.ndarray) -> np.ndarray:
    """Coordinates clipped to the open interval (0, 1)."""
    return np.clip(coordinates, UNIT_MARGIN, 1.0 - UNIT_MARGIN)


@dataclass(frozen=True)
class KeySource:
    """Numbers drawn with a random key."""

    key: Key

    def _typed_key(self) -> Array:
        return jax.random.wrap_key_data(self.key, impl="threefry2x32")

    def normals(self, shape: tuple[int, ...]) -> Array:
        """Standard normal numbers."""
        return jax.random.normal(self._typed_key(), shape, dtype=jnp.float64)

    def uniforms(self, shape: tuple[int, ...]) -> Array:
        """Numbers uniform in [0, 1)."""
        return jnp.asarray(jax.random.uniform(self._typed_key(), shape, dtype=jnp.float64))

    def integer(self, count: int) -> Array:
        """Integer uniform in [0, count)."""
        return jax.random.randint(self._typed_key(), (), 0, count)

    def direction(self) -> Float[Array, "3"]:
        """Unit vector uniform on the sphere."""
        return quaternion.normalize(self.normals((3,)))

    def attitude(self) -> Float[Array, "4"]:
        """Unit quaternion uniform over all attitudes."""
        return quaternion.normalize(self.normals((4,)))


@dataclass(frozen=True)
class CoordinateSource:
    """Numbers from a point of the unit cube by inverse distribution functions.

    Attributes:
        coordinates: (n,) in (0, 1), as many as `dispersion_keys.coordinate_count` says
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


RandomSource = KeySource | CoordinateSource
"""Random numbers of one dispersion in one run; exactly one method is called, once."""
