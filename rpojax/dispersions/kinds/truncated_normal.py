"""Dispersion by truncated normal errors of each component."""

from typing import ClassVar, Literal

import numpy as np
import scipy

from rpojax.dispersions.kinds.component_count_checks import check_one_or_each
from rpojax.dispersions.kinds.dispersion_kind import SingleKeyKind
from rpojax.dispersions.marginal_distribution import Distribution
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.value_types import NonNegative, Positive


class TruncatedNormal(SingleKeyKind):
    """Nominal value plus a normal error truncated at `limit_sigmas`, per component."""

    kind: Literal["truncated_normal"]
    sigma: NonNegative | list[NonNegative]
    limit_sigmas: Positive

    given_settings: ClassVar[tuple[str, ...]] = ("sigma",)

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that `sigma` fits the key."""
        check_one_or_each(f"{where}.sigma", self.sigma, nominal.shape)

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run, in the unit of the key."""
        import jax.numpy as jnp
        from jax.scipy.special import ndtr, ndtri

        low, high = ndtr(-self.limit_sigmas), ndtr(self.limit_sigmas)
        truncated = ndtri(low + (high - low) * source.uniforms(nominal.shape))
        return nominal + jnp.asarray(self.sigma, dtype=jnp.float64) * truncated

    def varies(self, nominal: np.ndarray) -> np.ndarray:
        """(coordinates,) bool, whether a coordinate has an effect."""
        return np.broadcast_to(np.ravel(self.sigma) > 0.0, (nominal.size,))

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component about `nominal` (n,)."""
        limit = self.limit_sigmas
        sigmas = np.broadcast_to(self.sigma, nominal.shape)
        return [
            scipy.stats.truncnorm(-limit, limit, loc=mean, scale=sigma) if sigma > 0.0 and np.isfinite(mean) else None
            for mean, sigma in zip(nominal, sigmas, strict=True)
        ]

    def reach(self, nominal: np.ndarray) -> np.ndarray:
        """Where the errors are truncated, at most three sigma on either side."""
        width = min(self.limit_sigmas, 3.0) * np.asarray(self.sigma, dtype=np.float64)
        return np.stack([nominal - width, nominal + width])

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (...) of a value, and its change (size, size) per sigma of standard normal inputs."""
        truncated = scipy.stats.truncnorm.std(-self.limit_sigmas, self.limit_sigmas)
        sigma = truncated * np.broadcast_to(np.asarray(self.sigma, dtype=float), nominal.shape)
        return nominal, np.diag(sigma.reshape(-1))
