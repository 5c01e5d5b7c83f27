"""Probability that a JAX function of standard normal numbers, and of noise, is at or below zero."""

from collections.abc import Callable
from typing import Any, get_args

import jax
import numpy as np

from rpojax.analysis.reliability.rare_events import estimate_by_method
from rpojax.analysis.reliability.rare_events.latent_points import (
    LatentPoints,
    LatentSpace,
    LimitFunction,
    LimitStateCalls,
)
from rpojax.analysis.reliability.rare_events.probability_estimate import MethodChoice, ProbabilityEstimate
from rpojax.errors import RpojaxError
from rpojax.runtime import jax_configuration
from rpojax.runtime.progress import stage

jax_configuration.enable_double_precision()

MIN_BUDGET = 200
_MOVED_NOISE = 200
"""Noise numbers up to which chains and proposals move them; more are drawn anew in blocks."""
_NOISE_BLOCKS = 16
_LARGEST_BATCH = 4096


def estimate_probability(
    limit_state: Callable[..., Any],
    dimension: int,
    *,
    budget: int = 10_000,
    seed: int = 0,
    method: str = "auto",
    noise_dimension: int = 0,
    progress: bool = True,
) -> ProbabilityEstimate:
    """Probability of failure, with an interval that says how far it can be trusted.

    Args:
        limit_state: margins (batch,) of standard normal numbers z (batch, dimension), or of z and of independent
            standard normal noise (batch, noise_dimension); failure where at or below zero, or undefined
        dimension: of z
        budget: most points at which the limit state is evaluated
        seed: of the random numbers
        method: 'auto', or 'subset', 'importance', 'line' or 'plain'
        noise_dimension: of the noise; without any the limit state is a function of z alone
        progress: show in a terminal that it is under way

    Raises:
        RpojaxError: an argument is out of range, or the limit state does not return one margin a point.
    """
    _check(dimension, budget, seed, method, noise_dimension)
    moved = noise_dimension if noise_dimension <= _MOVED_NOISE else 0
    blocks = 0 if moved == noise_dimension else _NOISE_BLOCKS
    space = LatentSpace(dimension + moved, blocks)
    calls = LimitStateCalls(_as_limit_function(limit_state, dimension, noise_dimension), space, budget)
    chosen: MethodChoice = method  # pyright: ignore[reportAssignmentType]
    with stage("estimating the probability", quiet=not progress, announce=False):
        return estimate_by_method.estimate(calls, np.random.default_rng(seed), chosen)


def _check(dimension: int, budget: int, seed: int, method: str, noise_dimension: int) -> None:
    """Refuses arguments that cannot be used.

    Raises:
        RpojaxError: naming the argument.
    """
    for name, value, least in (
        ("dimension", dimension, 1),
        ("budget", budget, MIN_BUDGET),
        ("seed", seed, 0),
        ("noise_dimension", noise_dimension, 0),
    ):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise RpojaxError.of_argument(name, f"found {value!r}, expected a whole number of at least {least}")
    known = ", ".join(get_args(MethodChoice))
    if method not in get_args(MethodChoice):
        raise RpojaxError.of_argument("method", f"found {method!r}, expected one of {known}")


def _as_limit_function(limit_state: Callable[..., Any], dimension: int, noise_dimension: int) -> LimitFunction:
    """Margins of points by a JAX function, which is called with batches of few sizes: it compiles for each of them."""

    def margins(points: LatentPoints) -> np.ndarray:
        found, begin = [], 0
        while begin < len(points):
            size = min(_LARGEST_BATCH, 1 << ((len(points) - begin).bit_length() - 1))
            part = points.rows(slice(begin, begin + size))
            arguments = [jax.device_put(part.x[:, :dimension])]
            if noise_dimension:
                arguments.append(jax.device_put(_noise(part, dimension, noise_dimension)))
            found.append(_checked(np.asarray(limit_state(*arguments)), size))
            begin += size
        return np.concatenate(found)

    return margins


def _noise(points: LatentPoints, dimension: int, count: int) -> np.ndarray:
    """Noise numbers (n, count): moved with the points, or drawn from the keys of their blocks."""
    if points.keys.shape[1] == 0:
        return points.x[:, dimension:]
    sizes = np.diff(np.linspace(0, count, points.keys.shape[1] + 1).astype(int))
    rows = [
        np.concatenate(
            [np.random.Generator(np.random.Philox(key)).standard_normal(n) for key, n in zip(keys, sizes, strict=True)]
        )
        for keys in points.keys.tolist()
    ]
    return np.stack(rows)


def _checked(margins: np.ndarray, count: int) -> np.ndarray:
    """Margins (count,), also from a column.

    Raises:
        RpojaxError: the limit state returned another shape, or no real numbers.
    """
    if margins.shape not in ((count,), (count, 1)):
        raise RpojaxError.of_argument("limit_state", f"found margins of shape {margins.shape}, expected ({count},)")
    if margins.dtype.kind not in "fiub":
        raise RpojaxError.of_argument("limit_state", f"found margins of type {margins.dtype}, expected real numbers")
    return margins.reshape(count).astype(np.float64)
