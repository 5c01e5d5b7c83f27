"""Dispersion by normal errors of each component."""

from typing import ClassVar, Literal

import numpy as np

from rpojax.dispersions.kinds.component_count_checks import check_one_or_each
from rpojax.dispersions.kinds.dispersion_kind import SingleKeyKind
from rpojax.dispersions.marginal_distribution import Distribution, normal_distributions
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.value_types import NonNegative


class Normal(SingleKeyKind):
    """Nominal value plus a normal error, per component."""

    kind: Literal["normal"]
    sigma: NonNegative | list[NonNegative]

    given_settings: ClassVar[tuple[str, ...]] = ("sigma",)

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that `sigma` fits the key."""
        check_one_or_each(f"{where}.sigma", self.sigma, nominal.shape)

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run, in the unit of the key."""
        import jax.numpy as jnp

        return nominal + jnp.asarray(self.sigma, dtype=jnp.float64) * source.normals(nominal.shape)

    def varies(self, nominal: np.ndarray) -> np.ndarray:
        """(coordinates,) bool, whether a coordinate has an effect."""
        return np.broadcast_to(np.ravel(self.sigma) > 0.0, (nominal.size,))

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component about `nominal` (n,)."""
        return normal_distributions(nominal, self.sigma)

    def reach(self, nominal: np.ndarray) -> np.ndarray:
        """Three sigma on either side of the nominal value."""
        width = 3.0 * np.asarray(self.sigma, dtype=np.float64)
        return np.stack([nominal - width, nominal + width])

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (...) of a value, and its change (size, size) per sigma of standard normal inputs."""
        sigma = np.broadcast_to(np.asarray(self.sigma, dtype=float), nominal.shape)
        return nominal, np.diag(sigma.reshape(-1))
