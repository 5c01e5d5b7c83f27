"""Dispersion by small rotations of the nominal attitude."""

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np

from rpojax.dispersions.kinds.component_count_checks import check_component_count, check_one_or_each
from rpojax.dispersions.kinds.dispersion_kind import SingleKeyKind
from rpojax.dispersions.marginal_distribution import Distribution, normal_distributions
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.value_types import NonNegative

_AXES = "xyz"


class SmallRotation(SingleKeyKind):
    """Nominal quaternion rotated by a normal rotation vector."""

    kind: Literal["small_rotation"]
    sigma_deg: NonNegative | list[NonNegative]

    is_separable: ClassVar[bool] = False
    given_settings: ClassVar[tuple[str, ...]] = ("sigma_deg",)

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that the key is that of a quaternion, and that `sigma_deg` fits its three axes."""
        check_component_count(where, self.kind, nominal, 4)
        check_one_or_each(f"{where}.sigma_deg", self.sigma_deg, (3,))

    def coordinate_count(self, nominal: np.ndarray) -> int:
        """Three, one for each axis."""
        return len(_AXES)

    def coordinate_labels(self, components: Sequence[str]) -> list[str]:
        """Name of each coordinate: the key with the number of the axis."""
        return list(components[: len(_AXES)])

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run."""
        import jax.numpy as jnp

        from rpojax.core import quaternion

        sigma = jnp.deg2rad(jnp.asarray(self.sigma_deg, dtype=jnp.float64))
        return quaternion.multiply(quaternion.exp(sigma * source.normals((3,))), quaternion.normalize(nominal))

    def varies(self, nominal: np.ndarray) -> np.ndarray:
        """(3,) bool, whether a coordinate has an effect."""
        return np.broadcast_to(np.asarray(self.sigma_deg) > 0.0, (len(_AXES),))

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of the rotation about each axis [deg]."""
        return normal_distributions(np.zeros(len(_AXES)), self.sigma_deg)

    def shown_numbers(self, values: np.ndarray, nominal: np.ndarray) -> dict[str, np.ndarray]:
        """Rotations (runs,) [deg] about each axis from the nominal attitude (4,) to the values (runs, 4)."""
        turns = _rotation_vectors_deg(values, nominal)
        return {f"[about {axis}, deg]": turn for axis, turn in zip(_AXES, turns.T, strict=True)}

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (4,) of a value, and its change (4, 3) per sigma of standard normal inputs."""
        import jax
        import jax.numpy as jnp

        from rpojax.core import quaternion

        sigma = np.broadcast_to(np.deg2rad(np.asarray(self.sigma_deg, dtype=float)), (3,))

        def turned(angle: jax.Array) -> jax.Array:
            return quaternion.multiply(quaternion.exp(angle), quaternion.normalize(jnp.asarray(nominal)))

        return np.asarray(turned(jnp.zeros(3))), np.asarray(jax.jacfwd(turned)(jnp.zeros(3))) * sigma


def _rotation_vectors_deg(quaternions: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) [deg] that turn the quaternion `start` (4,) into each of `quaternions` (n, 4)."""
    w, x, y, z = start / np.linalg.norm(start)
    # Matrix of p -> p q* for the conjugate of q = (w, x, y, z).
    back = np.array([[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
    turn = quaternions @ back.T
    turn = np.where(turn[:, :1] < 0.0, -turn, turn)
    size = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, turn[:, :1])
    return np.degrees(turn[:, 1:] * np.divide(angle, size, out=np.full_like(size, 2.0), where=size > 0.0))
