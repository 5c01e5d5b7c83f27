"""Fixed-step Runge-Kutta integration of pytrees: the classical method of order four, and one of order eight."""

import math
from collections.abc import Callable
from typing import Any, Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.numerics.short_scan import short_scan

State = TypeVar("State")
Method = Literal["rk4", "rk8"]
Derivative = Callable[[State, Any], State]

_SQRT_21 = math.sqrt(21.0)
NODES: dict[Method, tuple[float, ...]] = {
    "rk4": (0.0, 0.5, 1.0),
    "rk8": (0.0, (7.0 - _SQRT_21) / 14.0, 0.5, (7.0 + _SQRT_21) / 14.0, 1.0),
}
"""Fractions of a step at which a method evaluates its inputs."""


def step(
    method: Method, derivative: Derivative[State], state: State, inputs: Any, dt: float | Float[Array, ""]
) -> State:
    """State after one step of `dt` [s]; see `increment`."""
    return _add(state, increment(method, derivative, state, inputs, dt))


def rk4(derivative: Derivative[State], state: State, inputs: Any, dt: float | Float[Array, ""]) -> State:
    """State after one step of `dt` [s] by the classical fourth-order method; see `increment`."""
    return step("rk4", derivative, state, inputs, dt)


def increment(
    method: Method, derivative: Derivative[State], state: State, inputs: Any, dt: float | Float[Array, ""]
) -> State:
    """Increment of the state over one step of `dt` [s].

    The leaves of `inputs` hold the second argument of `derivative` at each of the method's `NODES`, along their first
    axis.
    """
    return _rk4(derivative, state, inputs, dt) if method == "rk4" else _rk8(derivative, state, inputs, dt)


def _add(state: State, increment: State) -> State:
    return jax.tree.map(lambda y, dy: y + dy, state, increment)


def _rk4(derivative: Derivative[State], state: State, inputs: Any, dt: float | Float[Array, ""]) -> State:
    """The classical fourth-order Runge-Kutta method.

    The four stages are a loop on a CPU: a quarter of the code to compile, and each stage is computed once.
    """
    dtype = jnp.result_type(*jax.tree.leaves(state))
    stages = (
        jax.tree.map(lambda nodes: jnp.stack([nodes[0], nodes[1], nodes[1], nodes[2]]), inputs),
        jnp.array([0.5 * dt, 0.5 * dt, dt, 0.0], dtype=dtype),
        jnp.array([dt / 6.0, dt / 3.0, dt / 3.0, dt / 6.0], dtype=dtype),
    )

    def stage(carry: tuple[State, State], inputs: tuple[Any, Array, Array]) -> tuple[tuple[State, State], None]:
        point, total = carry
        value, offset, weight = inputs
        slope = derivative(point, value)
        point = jax.tree.map(lambda y, k: y + offset * k, state, slope)
        return (point, jax.tree.map(lambda y, k: y + weight * k, total, slope)), None

    return short_scan(stage, (state, jax.tree.map(jnp.zeros_like, state)), stages)[1]


_RK8_NODE_INDICES = np.array([0, 2, 2, 3, 3, 2, 1, 1, 2, 3, 4])
_RK8_WEIGHTS = np.array([9, 0, 0, 0, 0, 0, 0, 49, 64, 49, 9]) / 180.0
_RK8_COEFFICIENTS: dict[tuple[int, int], float] = {
    (1, 0): 1 / 2,
    (2, 0): 1 / 4,
    (2, 1): 1 / 4,
    (3, 0): 1 / 7,
    (3, 1): -(7 + 3 * _SQRT_21) / 98,
    (3, 2): (21 + 5 * _SQRT_21) / 49,
    (4, 0): (11 + _SQRT_21) / 84,
    (4, 2): (18 + 4 * _SQRT_21) / 63,
    (4, 3): (21 - _SQRT_21) / 252,
    (5, 0): (5 + _SQRT_21) / 48,
    (5, 2): (9 + _SQRT_21) / 36,
    (5, 3): (-231 + 14 * _SQRT_21) / 360,
    (5, 4): (63 - 7 * _SQRT_21) / 80,
    (6, 0): (10 - _SQRT_21) / 42,
    (6, 2): (-432 + 92 * _SQRT_21) / 315,
    (6, 3): (633 - 145 * _SQRT_21) / 90,
    (6, 4): (-504 + 115 * _SQRT_21) / 70,
    (6, 5): (63 - 13 * _SQRT_21) / 35,
    (7, 0): 1 / 14,
    (7, 4): (14 - 3 * _SQRT_21) / 126,
    (7, 5): (13 - 3 * _SQRT_21) / 63,
    (7, 6): 1 / 9,
    (8, 0): 1 / 32,
    (8, 4): (91 - 21 * _SQRT_21) / 576,
    (8, 5): 11 / 72,
    (8, 6): -(385 + 75 * _SQRT_21) / 1152,
    (8, 7): (63 + 13 * _SQRT_21) / 128,
    (9, 0): 1 / 14,
    (9, 4): 1 / 9,
    (9, 5): -(733 + 147 * _SQRT_21) / 2205,
    (9, 6): (515 + 111 * _SQRT_21) / 504,
    (9, 7): -(51 + 11 * _SQRT_21) / 56,
    (9, 8): (132 + 28 * _SQRT_21) / 245,
    (10, 4): (-42 + 7 * _SQRT_21) / 18,
    (10, 5): (-18 + 28 * _SQRT_21) / 45,
    (10, 6): -(273 + 53 * _SQRT_21) / 72,
    (10, 7): (301 + 53 * _SQRT_21) / 72,
    (10, 8): (28 - 28 * _SQRT_21) / 45,
    (10, 9): (49 - 7 * _SQRT_21) / 18,
}


def _rk8(derivative: Derivative[State], state: State, inputs: Any, dt: float | Float[Array, ""]) -> State:
    """The eleven-stage method of order eight.

    Cooper and Verner, "Some explicit Runge-Kutta methods of high order", 1972.
    """
    count = len(_RK8_NODE_INDICES)
    columns = np.zeros((count, count + 1))
    for (row, column), value in _RK8_COEFFICIENTS.items():
        columns[column, row] = value
    columns[:, count] = _RK8_WEIGHTS

    def stage(sums: State, plan: tuple[Array, Array, Array]) -> tuple[State, None]:
        number, weights, node = plan
        point = jax.tree.map(lambda y, total: y + dt * total[number], state, sums)
        slope = fusion_barrier(derivative(point, jax.tree.map(lambda nodes: nodes[node], inputs)), number)

        def with_slope(total: Array, k: Array) -> Array:
            return total + weights.reshape(-1, *[1] * k.ndim) * k[None]

        return jax.tree.map(with_slope, sums, slope), None

    none = jax.tree.map(lambda y: jnp.zeros((count + 1, *y.shape), dtype=y.dtype), state)
    plan = (jnp.arange(count), jnp.asarray(columns), jnp.asarray(_RK8_NODE_INDICES))
    sums, _ = jax.lax.scan(stage, none, plan)
    return jax.tree.map(lambda total: dt * total[count], sums)
