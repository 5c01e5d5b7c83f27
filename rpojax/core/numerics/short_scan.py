"""A scan over a few passes, such as the stages of an integrator."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax

Carry = TypeVar("Carry")


def short_scan(
    body: Callable[[Carry, Any], tuple[Carry, Any]], carry: Carry, inputs: Any, *, unrolled: bool | None = None
) -> Carry:
    """What is carried after one pass of `body` for each row of `inputs`, as `lax.scan`.

    On a CPU it is a loop, which compiles several times faster. An accelerator, which starts every kernel of a pass by
    itself and copies what is carried between two, gets all passes one after the other, fused. `unrolled` decides
    otherwise.
    """
    if unrolled is None:
        unrolled = jax.default_backend() != "cpu"
    return jax.lax.scan(body, carry, inputs, unroll=unrolled or 1)[0]
