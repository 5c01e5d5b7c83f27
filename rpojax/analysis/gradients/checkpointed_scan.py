"""Scan with checkpoints: the reverse mode keeps some states and computes the others again (rematerialisation)."""

from collections.abc import Callable
from typing import Any

import jax


def checkpoint_interval(ticks: int, state_bytes: int, runs: int, memory_bytes: int) -> int:
    """Ticks from one kept state to the next in reverse mode: 1 if all fit, else the interval of least memory."""
    if ticks * state_bytes * runs <= memory_bytes:
        return 1
    return max(2, round(ticks**0.5))


def checkpointed_scan(function: Callable[[Any], Any], start: Any, length: int, interval: int) -> Any:
    """`function` applied `length` times; the reverse mode keeps one state in every `interval`, none at all with 0.

    Within a tick nothing is kept: computing it again is cheaper than the traffic to memory.
    """
    if interval == 0:
        return jax.lax.scan(lambda carry, _: (function(carry), None), start, None, length=length)[0]
    body = jax.checkpoint(function)

    def scan_ticks(carry: Any, count: int) -> Any:
        return jax.lax.scan(lambda inner, _: (body(inner), None), carry, None, length=count)[0]

    if interval == 1:
        return scan_ticks(start, length)
    scan_interval = jax.checkpoint(lambda carry: scan_ticks(carry, interval))
    carry = jax.lax.scan(lambda inner, _: (scan_interval(inner), None), start, None, length=length // interval)[0]
    return scan_ticks(carry, length % interval)
