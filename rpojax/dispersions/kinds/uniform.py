"""Dispersion uniform between bounds."""

from typing import ClassVar, Literal

import numpy as np
import scipy
from pydantic import model_validator

from rpojax.dispersions.kinds.dispersion_kind import ExtremeValue, SingleKeyKind
from rpojax.dispersions.marginal_distribution import Distribution
from rpojax.dispersions.random_source import Array, RandomSource
from rpojax.value_types import Finite


class Uniform(SingleKeyKind):
    """Uniform between two bounds, per component."""

    kind: Literal["uniform"]
    low: Finite
    high: Finite

    uses_nominal: ClassVar[bool] = False

    @model_validator(mode="after")
    def _check_order(self) -> "Uniform":
        if self.low > self.high:
            raise ValueError("expected low at most high")
        return self

    def check(self, where: str, nominal: np.ndarray) -> None:
        """Any numbers may be uniform."""

    def extreme_values(self, shape: tuple[int, ...]) -> list[ExtremeValue]:
        """Both bounds; no run has all components at a bound."""
        bounds = {"low": self.low, "high": self.high}
        return [ExtremeValue(name, end, np.full(shape, end).tolist(), whole=False) for name, end in bounds.items()]

    def draw(self, nominal: Array, source: RandomSource) -> Array:
        """Value of one run, in the unit of the key."""
        return self.low + (self.high - self.low) * source.uniforms(nominal.shape)

    def varies(self, nominal: np.ndarray) -> np.ndarray:
        """(coordinates,) bool, whether a coordinate has an effect."""
        return np.full(nominal.size, self.low < self.high)

    def marginals(self, nominal: np.ndarray) -> list[Distribution | None]:
        """Distribution of each component."""
        width = self.high - self.low
        return [scipy.stats.uniform(self.low, width) if width > 0.0 else None] * len(nominal)

    def reach(self, nominal: np.ndarray) -> np.ndarray:
        """Both bounds."""
        return np.stack([np.full_like(nominal, self.low), np.full_like(nominal, self.high)])

    def linearise(self, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (...) of a value, and its change (size, size) per sigma of standard normal inputs."""
        middle = np.full_like(nominal, 0.5 * (self.low + self.high))
        return middle, (self.high - self.low) / np.sqrt(12.0) * np.eye(nominal.size)
