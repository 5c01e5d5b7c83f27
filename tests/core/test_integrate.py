"""The Runge-Kutta step: its order, what it integrates exactly, and its pytrees."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.integrate import rk4


@pytest.fixture(scope="module")
def error() -> Callable[[int], float]:
    """Error at t = 1 of y' = u - y^2 with the forcing u under which y is sin t, for a number of steps."""

    def derivative(y: dict[str, jax.Array], u: jax.Array) -> dict[str, jax.Array]:
        return {"value": u - y["value"] ** 2}

    def forcing(t: jax.Array) -> jax.Array:
        return jnp.cos(t) + jnp.sin(t) ** 2

    def run(steps: int) -> float:
        dt = 1.0 / steps

        def body(y: dict[str, jax.Array], k: jax.Array) -> tuple[dict[str, jax.Array], None]:
            t = k * dt
            return rk4(derivative, y, (forcing(t), forcing(t + 0.5 * dt), forcing(t + dt)), dt), None

        start = {"value": jnp.zeros(())}
        end, _ = jax.lax.scan(body, start, jnp.arange(steps, dtype=jnp.float64))
        return abs(float(end["value"]) - float(np.sin(1.0)))

    return run


def test_halving_the_step_divides_the_error_by_sixteen(error: Callable[[int], float]) -> None:
    orders = [np.log2(error(n) / error(2 * n)) for n in (16, 32)]
    np.testing.assert_allclose(orders, 4.0, atol=0.25)  # the next power of the step is still felt


def test_a_cubic_in_time_is_integrated_exactly() -> None:
    start, middle, end = (jnp.asarray(1.0 + 2.0 * t - 3.0 * t**2 + 4.0 * t**3) for t in (0.0, 1.0, 2.0))
    after = rk4(lambda _, u: u, jnp.asarray(5.0), (start, middle, end), 2.0)
    np.testing.assert_allclose(after, 5.0 + 2.0 + 4.0 - 8.0 + 16.0, rtol=1e-15)


def test_every_leaf_of_the_state_advances_by_its_own_slope() -> None:
    zero = jnp.zeros(())
    state = {"a": jnp.zeros(2), "b": (jnp.ones(()),)}
    after = rk4(lambda y, _: {"a": jnp.ones(2), "b": (2.0 * jnp.ones(()),)}, state, (zero, zero, zero), 0.5)
    np.testing.assert_allclose(after["a"], [0.5, 0.5])
    np.testing.assert_allclose(after["b"][0], 2.0)
