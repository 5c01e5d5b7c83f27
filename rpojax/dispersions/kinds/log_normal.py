"""Dispersion by a log-normal factor on each component."""

from typing import ClassVar, Literal

import numpy as np
import scipy

from rpojax.dispersions.kinds.component_count_checks import check_one_or_each
from rpojax.dispersions.kinds.dispersion_kind import SingleKeyKind
from rpojax.dispersions.marginal_distribution import Distribution
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.errors import ScenarioError
from rpojax.value_types import NonNegative

_LARGEST_SIGMA = 5.0


class LogNormal(SingleKeyKind):
    """Nominal value times the exponential of a normal number, per component; `sigma` is at most 5."""

    kind: Literal["log_normal"]
    sigma: NonNegative | list[NonNegative]

    given_settings: ClassVar[tuple[str, ...]] = ("sigma",)

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that `sigma` fits the key, and that nominal values are positive."""
        check_one_or_each(f"{where}.sigma", self.sigma, nominal.shape)
        if np.max(self.sigma) > _LARGEST_SIGMA:
            most = f"at most {_LARGEST_SIGMA:g}, a factor of {np.exp(3.0 * _LARGEST_SIGMA):.2g} at three sigma"
            raise ScenarioError(f"{where}.sigma", self.sigma, most)
        if np.any(nominal <= 0.0):
            raise ScenarioError(f"{where}.key", self.key, "a nominal value above zero for a log-normal")

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run, in the unit of the key."""
        import jax.numpy as jnp

        return nominal * jnp.exp(jnp.asarray(self.sigma, dtype=jnp.float64) * source.normals(nominal.shape))

    def varies(self, nominal: np.ndarray) -> np.ndarray:
        """(coordinates,) bool, whether a coordinate has an effect."""
        return np.broadcast_to(np.ravel(self.sigma) > 0.0, (nominal.size,))

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component with the median `nominal` (n,)."""
        sigmas = np.broadcast_to(self.sigma, nominal.shape)
        return [
            scipy.stats.lognorm(sigma, scale=median) if sigma > 0.0 and median > 0.0 else None
            for median, sigma in zip(nominal, sigmas, strict=True)
        ]

    def reach(self, nominal: np.ndarray) -> np.ndarray:
        """Three sigma of the logarithm on either side of the nominal value."""
        factor = np.exp(3.0 * np.asarray(self.sigma, dtype=np.float64))
        return np.stack([nominal / factor, nominal * factor])

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (...) of a value, and its change (size, size) per sigma of standard normal inputs."""
        square = np.broadcast_to(np.asarray(self.sigma, dtype=float) ** 2, nominal.shape)
        mean = np.asarray(nominal * np.exp(0.5 * square))
        return mean, np.diag((np.abs(mean) * np.sqrt(np.expm1(square))).reshape(-1))
