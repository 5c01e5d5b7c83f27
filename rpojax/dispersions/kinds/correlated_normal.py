"""Dispersion of several numbers by correlated normal errors."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from rpojax.dispersions.kinds.dispersion_kind import RandomKind
from rpojax.dispersions.marginal_distribution import Distribution, normal_distributions
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.dispersions.semidefinite_cholesky import cholesky_factor
from rpojax.errors import ScenarioError
from rpojax.value_types import Covariance


class CorrelatedNormal(RandomKind):
    """Nominal values plus normal errors with a covariance; the key of a vector stands for its components."""

    keys: Annotated[list[str], Field(min_length=1, max_length=64)]
    kind: Literal["correlated_normal"]
    covariance: Covariance

    is_joint: ClassVar[bool] = True
    is_separable: ClassVar[bool] = False

    @property
    def key_texts(self) -> list[str]:
        """Keys that are assigned, as written in the scenario."""
        return self.keys

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Checks that the covariance has a row for each component."""
        if len(self.covariance) != nominal.size:
            found = f"{len(self.covariance)} rows"
            raise ScenarioError(f"{where}.covariance", found, f"one for each of the {nominal.size} components of keys")

    def coordinate_count(self, nominal: np.ndarray) -> int:
        """One for each component."""
        return nominal.size

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Values (n,) of one run; error `i` depends on the random numbers up to `i`."""
        factor = self._factor()
        return nominal + (factor * source.normals((len(factor),))[None, :]).sum(axis=1)

    def varies(self, nominal: np.ndarray) -> np.ndarray:
        """(coordinates,) bool, whether a coordinate has an effect."""
        return np.any(self._factor() != 0.0, axis=0)

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component about `nominal` (n,)."""
        return normal_distributions(nominal, np.sqrt(np.diag(np.array(self.covariance, dtype=np.float64))))

    def reach(self, nominal: np.ndarray) -> np.ndarray:
        """Three sigma of each component on either side of its nominal value."""
        width = 3.0 * np.sqrt(np.diag(np.array(self.covariance, dtype=np.float64)))
        return np.stack([nominal - width, nominal + width])

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n,) of the values, and their change (n, n) per sigma of standard normal inputs."""
        return nominal, self._factor()

    def _factor(self) -> np.ndarray:
        return cholesky_factor(np.array(self.covariance))
