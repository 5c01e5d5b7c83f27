"""A scan over a number of passes that is known only when it runs."""

from collections.abc import Callable
from typing import Any, Final, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

Carry = TypeVar("Carry")

PASSES_AT_ONCE: Final = 10
"""Passes in a loop of known length, within the one of unknown length."""


def scan_to_count(
    body: Callable[[Carry], tuple[Carry, Any]], carry: Carry, count: Int[Array, ""], most: int
) -> tuple[Carry, Any]:
    """What is carried after `count` passes of `body`, and the results of all passes, stacked in `most` rows.

    As `lax.scan` without inputs, but one compiled program serves any `count` up to `most`. A count that is no multiple
    of `PASSES_AT_ONCE` is rounded up to one, as `most` must be; rows of passes that are not made are zero.
    """
    # Traced once, for the shapes of the results and in the loop.
    passes = jax.jit(lambda carry: jax.lax.scan(lambda now, _: body(now), carry, None, length=PASSES_AT_ONCE))
    _, shapes = jax.eval_shape(passes, carry)
    rows = jax.tree.map(lambda shape: jnp.zeros((most, *shape.shape[1:]), shape.dtype), shapes)

    def advance(number: Int[Array, ""], before: tuple[Carry, Any]) -> tuple[Carry, Any]:
        after, results = passes(before[0])
        return after, jax.tree.map(
            lambda stacked, result: jax.lax.dynamic_update_slice_in_dim(
                stacked, result, number * PASSES_AT_ONCE, axis=0, allow_negative_indices=False
            ),
            before[1],
            results,
        )

    times = (count + (PASSES_AT_ONCE - 1)) // PASSES_AT_ONCE
    return jax.lax.fori_loop(0, times, advance, (carry, rows))
