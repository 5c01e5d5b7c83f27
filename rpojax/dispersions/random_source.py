"""What kinds of dispersion draw from, in one run."""

from typing import Protocol, runtime_checkable

from jax import Array


@runtime_checkable
class RandomSource(Protocol):
    """Random numbers of one dispersion in one run; exactly one method is called, once."""

    def normals(self, shape: tuple[int, ...]) -> Array:
        """Standard normal numbers."""
        ...

    def uniforms(self, shape: tuple[int, ...]) -> Array:
        """Numbers uniform in the unit interval."""
        ...

    def integer(self, count: int) -> Array:
        """Integer uniform in [0, count)."""
        ...

    def direction(self) -> Array:
        """Unit vector (3,) uniform on the sphere."""
        ...

    def attitude(self) -> Array:
        """Unit quaternion (4,) uniform over all attitudes."""
        ...
