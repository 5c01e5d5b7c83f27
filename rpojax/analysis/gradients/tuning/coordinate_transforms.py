"""Transforms of bounded numbers to unbounded coordinates: logarithm and logit."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


@dataclass(frozen=True)
class LogCoordinate:
    """Logarithm of positive numbers: a step of 0.1 is about ten per cent."""

    def contains(self, value: np.ndarray) -> bool:
        """Whether all are positive."""
        return bool(np.all(value > 0.0))

    def to_coordinate(self, value: np.ndarray) -> np.ndarray:
        """Coordinate of a value."""
        return np.asarray(np.log(value))

    def from_coordinate(self, x: Array) -> Array:
        """Value at a coordinate."""
        return jnp.exp(x)


@dataclass(frozen=True)
class LogitCoordinate:
    """Logit of numbers between two bounds."""

    low: float
    high: float

    def contains(self, value: np.ndarray) -> bool:
        """Whether all lie inside."""
        return bool(np.all((value > self.low) & (value < self.high)))

    def to_coordinate(self, value: np.ndarray) -> np.ndarray:
        """Coordinate of a value."""
        return np.asarray(np.log((value - self.low) / (self.high - value)))

    def from_coordinate(self, x: Array) -> Array:
        """Value at a coordinate."""
        return self.low + (self.high - self.low) * jax.nn.sigmoid(x)


Coordinate = LogCoordinate | LogitCoordinate
