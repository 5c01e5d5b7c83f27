"""A barrier that XLA does not fuse across."""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

T = TypeVar("T")


def fusion_barrier(tree: T, runtime_value: Array) -> T:
    """Returns `tree` unchanged, computed once and stored, for any `runtime_value` that is not negative.

    XLA on CPU fuses a computation into each of its uses and repeats it there. `lax.optimization_barrier` does not stop
    it, a branch that it cannot decide does. `runtime_value` must be unknown at compile time and the same for all runs
    of a batch, such as the tick; otherwise the branch becomes a select, which is no barrier.
    """
    return jax.lax.cond(runtime_value >= 0, lambda x: x, lambda x: jax.tree.map(jnp.zeros_like, x), tree)
