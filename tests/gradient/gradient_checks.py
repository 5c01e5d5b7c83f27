"""Comparison of derivatives with finite differences, and points at which kernels are differentiated."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.test_util import check_grads
from numpy_reference import random_unit

# Central differences with steps of 1e-6 of numbers near one: rounding 1e-10, and a margin for truncation.
TOLERANCE = 1e-5

RNG = np.random.default_rng(1)
Q, P = random_unit(RNG, 4), random_unit(RNG, 4)
V, W = random_unit(RNG), random_unit(RNG)
POSITION = np.array([4.0e6, -3.0e6, 4.5e6])

Kernel = Callable[..., Any]


def check(kernel: Kernel, size: int, *constants: Any) -> None:
    """Compares both derivatives of `kernel(x, *constants)` at x = 0 with finite differences.

    `kernel` is compiled and takes `size` numbers, each scaled so that 1 is a large change.
    """

    def function(x: jax.Array) -> Any:
        return kernel(x, *constants)

    check_grads(function, (np.zeros(size),), order=1, modes=["fwd", "rev"], atol=TOLERANCE, rtol=TOLERANCE)


def check_finite(kernel: Kernel, size: int, *constants: Any) -> None:
    """Checks that both derivatives are finite, at points where the kernel has a kink or a jump."""

    def function(x: jax.Array) -> Any:
        return kernel(x, *constants)

    value, forward = jax.jvp(function, (np.zeros(size),), (np.ones(size),))
    _, pull_back = jax.vjp(function, np.zeros(size))
    backward = pull_back(jax.tree.map(jnp.ones_like, value))
    for leaf in jax.tree.leaves((value, forward, backward)):
        assert np.all(np.isfinite(leaf))
