"""Stage borders that the compiler respects."""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

T = TypeVar("T")


def fusion_barrier(tree: T, runtime_value: Array) -> T:
    """Returns `tree` unchanged, computed once and stored, for any `marker` that is not negative.

    XLA on CPU fuses a stage into each element of the stages that use it, and computes it anew for each: an
    optimisation barrier does not stop it, a branch that it cannot decide does. `marker` must be a number known only at
    run time and the same for all runs of a batch, such as the tick; else the branch becomes a cheap but useless select.
    """
    return jax.lax.cond(runtime_value >= 0, lambda x: x, lambda x: jax.tree.map(jnp.zeros_like, x), tree)
