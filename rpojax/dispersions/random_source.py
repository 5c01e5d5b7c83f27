"""What kinds of dispersion draw from, in one run."""

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import jax


@runtime_checkable
class RandomSource(Protocol):
    """Random numbers of one dispersion in one run; exactly one method is called, once."""

    def normals(self, shape: tuple[int, ...]) -> "jax.Array":
        """Standard normal numbers."""
        ...

    def uniforms(self, shape: tuple[int, ...]) -> "jax.Array":
        """Numbers uniform in the unit interval."""
        ...

    def integer(self, count: int) -> "jax.Array":
        """Integer uniform in [0, count)."""
        ...

    def direction(self) -> "jax.Array":
        """Unit vector (3,) uniform on the sphere."""
        ...

    def attitude(self) -> "jax.Array":
        """Unit quaternion (4,) uniform over all attitudes."""
        ...
