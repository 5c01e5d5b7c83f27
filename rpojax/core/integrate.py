"""Fixed-step integration of pytrees."""

from collections.abc import Callable
from typing import TypeVar

import jax

State = TypeVar("State")
Input = TypeVar("Input")


def rk4(
    derivative: Callable[[State, Input], State], state: State, inputs: tuple[Input, Input, Input], dt: float
) -> State:
    """One step of the classical fourth-order Runge-Kutta method over `dt` [s].

    `inputs` are what `derivative` gets at the start, the middle and the end of the step.
    """

    def advance(slope: State, h: float) -> State:
        return jax.tree.map(lambda y, k: y + h * k, state, slope)

    start, middle, end = inputs
    k1 = derivative(state, start)
    k2 = derivative(advance(k1, 0.5 * dt), middle)
    k3 = derivative(advance(k2, 0.5 * dt), middle)
    k4 = derivative(advance(k3, dt), end)
    return jax.tree.map(lambda y, a, b, c, d: y + dt / 6.0 * (a + 2.0 * (b + c) + d), state, k1, k2, k3, k4)
