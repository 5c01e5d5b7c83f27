"""Random numbers of a dispersion from a random key: runs are independent."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion
from rpojax.core.random_streams import Key


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
