"""Finite differences without cancellation: numbers that carry their own change from one point to another."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class Difference:
    """A quantity at one point and its change to another.

    The rules are those of finite differences, exact at any distance: `(a b)' - a b = a' db + da b`. A formula in
    `+ - *` and `inverse_norm` gives a value and the difference of two values, both to full relative precision.

    Attributes:
        value: at the first point
        change: value at the second point less value at the first
    """

    value: Array
    change: Array

    def __add__(self, other: "Difference | float") -> "Difference":
        if isinstance(other, Difference):
            return Difference(value=self.value + other.value, change=self.change + other.change)
        return Difference(value=self.value + other, change=self.change)

    def __sub__(self, other: "Difference | float") -> "Difference":
        return self + other * -1.0

    def __mul__(self, other: "Difference | Array | float") -> "Difference":
        if isinstance(other, Difference):
            return self.scale(other)
        return Difference(value=self.value * other, change=self.change * other)

    def scale(self, vector: "Difference") -> "Difference":
        """Product of this scalar with another scalar or a vector (3,)."""
        return Difference(
            value=self.value * vector.value,
            change=self.change * (vector.value + vector.change) + self.value * vector.change,
        )

    def __getitem__(self, index: int) -> "Difference":
        return Difference(value=self.value[index], change=self.change[index])


def inverse_norm(vector: Difference) -> Difference:
    """One over the norm of a vector (3,)."""
    square = jnp.sum(vector.value * vector.value, axis=0)
    growth = jnp.sum(vector.change * (2.0 * vector.value + vector.change), axis=0) / square
    root = jnp.sqrt(1.0 + growth)
    inverse: Float[Array, ""] = 1.0 / jnp.sqrt(square)
    return Difference(value=inverse, change=-inverse * growth / (root * (1.0 + root)))
