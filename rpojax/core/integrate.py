"""Fixed-step integration of pytrees."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

State = TypeVar("State")
Scalar = Float[Array, ""]


def rk4(
    derivative: Callable[[State, Scalar], State], state: State, inputs: tuple[Scalar, Scalar, Scalar], dt: float
) -> State:
    """One step of the classical fourth-order Runge-Kutta method over `dt` [s].

    `inputs` are what `derivative` gets at the start, the middle and the end of the step. The four stages are a rolled
    loop: a quarter of the code to compile, and each stage is computed once.
    """
    start, middle, end = inputs
    stages = (
        jnp.stack([start, middle, middle, end]),
        jnp.array([0.5 * dt, 0.5 * dt, dt, 0.0], dtype=jnp.float64),
        jnp.array([dt / 6.0, dt / 3.0, dt / 3.0, dt / 6.0], dtype=jnp.float64),
    )

    def stage(carry: tuple[State, State], inputs: tuple[Scalar, Scalar, Scalar]) -> tuple[tuple[State, State], None]:
        at, total = carry
        value, reach, weight = inputs
        slope = derivative(at, value)
        at = jax.tree.map(lambda y, k: y + reach * k, state, slope)
        return (at, jax.tree.map(lambda y, k: y + weight * k, total, slope)), None

    (_, after), _ = jax.lax.scan(stage, (state, state), stages)
    return after
