"""Muon optimiser: steps along the orthogonalised momentum of a kernel.

Jordan et al., "Muon: an optimizer for hidden layers in neural networks", 2024. On these networks it needs far fewer
steps than Adam.
"""

from typing import Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array

_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
"""Of the odd polynomial of a Newton-Schulz step; five steps take singular values in 0.01..1 to near one."""
_ITERATIONS = 5


def scale_by_muon(momentum: float) -> optax.GradientTransformation:
    """Transformation of gradients to orthogonalised steps with Nesterov momentum, for kernels (..., in, out)."""

    def initialize(params: Any) -> Any:
        return jax.tree.map(jnp.zeros_like, params)

    def update(updates: Any, state: Any, params: Any = None) -> tuple[Any, Any]:
        del params
        state = jax.tree.map(lambda m, g: momentum * m + g, state, updates)
        step = jax.tree.map(lambda m, g: orthogonalize(momentum * m + g), state, updates)
        return step, state

    return optax.GradientTransformation(initialize, update)


def orthogonalize(kernel: Array) -> Array:
    """A kernel (..., in, out) as a matrix of `out` columns, with its singular values moved near one (Newton-Schulz)."""
    first, second, third = _COEFFICIENTS
    matrix = kernel.reshape(-1, kernel.shape[-1])
    tall = matrix.shape[0] >= matrix.shape[1]
    values = matrix.T if tall else matrix
    values = values / (jnp.sqrt(jnp.sum(values * values)) + 1e-7)
    for _ in range(_ITERATIONS):
        square = values @ values.T
        values = first * values + (second * square + third * square @ square) @ values
    return (values.T if tall else values).reshape(kernel.shape)
