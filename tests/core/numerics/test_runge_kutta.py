"""Runge-Kutta methods: order of convergence, exactness for polynomials, pytrees."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from rpojax.core.numerics import runge_kutta
from rpojax.core.numerics.runge_kutta import NODES, Method

METHODS: tuple[Method, ...] = ("rk4", "rk8")
ORDER = {"rk4": 4, "rk8": 8}

Pair = tuple[jax.Array, jax.Array]


def orders(error: Callable[[int], float], steps: tuple[int, ...]) -> list[float]:
    """Observed orders of convergence when each number of steps is doubled."""
    return [np.log2(error(n) / error(2 * n)) for n in steps]


@pytest.fixture(scope="module")
def forced_error() -> Callable[[Method, int], float]:
    """Error at t = 3 of y' = u - y^2 with the forcing u under which y is sin 2t, for a number of steps."""

    def derivative(y: dict[str, jax.Array], u: jax.Array) -> dict[str, jax.Array]:
        return {"value": u - y["value"] ** 2}

    def run(method: Method, steps: int) -> float:
        dt = 3.0 / steps
        times = dt * (np.arange(steps)[:, None] + np.array(NODES[method]))
        forcing = 2.0 * np.cos(2.0 * times) + np.sin(2.0 * times) ** 2

        def body(y: dict[str, jax.Array], nodes: jax.Array) -> tuple[dict[str, jax.Array], None]:
            return runge_kutta.step(method, derivative, y, nodes, dt), None

        end, _ = jax.lax.scan(body, {"value": jnp.zeros(())}, jnp.asarray(forcing))
        return abs(float(end["value"]) - float(np.sin(6.0)))

    return run


@pytest.fixture(scope="module")
def orbit_error() -> Callable[[Method, int], float]:
    """Error of the position on an orbit of eccentricity 0.3, a third of a revolution after its perigee."""
    e, time = 0.3, 2.0
    anomaly = brentq(lambda E: E - e * np.sin(E) - time, 0.0, np.pi, xtol=1e-15)
    exact = np.array([np.cos(anomaly) - e, np.sqrt(1.0 - e * e) * np.sin(anomaly)])

    def derivative(y: Pair, _: jax.Array) -> Pair:
        return y[1], -y[0] / jnp.sum(y[0] ** 2) ** 1.5

    def run(method: Method, steps: int) -> float:
        none = jnp.zeros(len(NODES[method]))

        def body(y: Pair, _: None) -> tuple[Pair, None]:
            return runge_kutta.step(method, derivative, y, none, time / steps), None

        start = (jnp.array([1.0 - e, 0.0]), jnp.array([0.0, np.sqrt((1.0 + e) / (1.0 - e))]))
        (position, _), _ = jax.lax.scan(body, start, None, length=steps)
        return float(np.linalg.norm(position - exact))

    return run


@pytest.mark.parametrize(("method", "steps"), [("rk4", (64, 128)), ("rk8", (12, 24))])
def test_a_forced_equation_converges_with_the_order_of_the_method(
    forced_error: Callable[[Method, int], float], method: Method, steps: tuple[int, int]
) -> None:
    found = orders(lambda n: forced_error(method, n), steps)
    np.testing.assert_allclose(found, ORDER[method], atol=0.3)  # the next power of the step still contributes


@pytest.mark.parametrize(("method", "steps"), [("rk4", (100, 200)), ("rk8", (12, 20))])
def test_an_orbit_converges_with_the_order_of_the_method(
    orbit_error: Callable[[Method, int], float], method: Method, steps: tuple[int, int]
) -> None:
    found = orders(lambda n: orbit_error(method, n), steps)
    np.testing.assert_allclose(found, ORDER[method], atol=0.1)


@pytest.mark.parametrize(("method", "degree"), [("rk4", 3), ("rk8", 7)])
def test_a_polynomial_in_time_is_integrated_exactly_up_to_the_degree_of_the_methods_quadrature(
    method: Method, degree: int
) -> None:
    times = 2.0 * np.array(NODES[method])
    after = runge_kutta.step(method, lambda _, u: u, jnp.asarray(5.0), jnp.asarray((degree + 1) * times**degree), 2.0)
    np.testing.assert_allclose(after, 5.0 + 2.0 ** (degree + 1), rtol=1e-15)


@pytest.mark.parametrize("method", METHODS)
def test_an_input_changes_the_second_integral_by_its_first_moment(method: Method) -> None:
    """For any values at the nodes: the quadrature of a force gives both velocity and position."""
    nodes = np.array(NODES[method])
    pushes = np.random.default_rng(1).normal(size=nodes.size)
    powers = np.arange(nodes.size)
    weights = np.linalg.solve(nodes[None, :] ** powers[:, None], 1.0 / (powers + 1.0))  # of interpolation
    start = (jnp.asarray(1.0), jnp.asarray(3.0))
    position, velocity = runge_kutta.step(method, lambda y, u: (y[1], u), start, jnp.asarray(pushes), 0.5)
    np.testing.assert_allclose(velocity, 3.0 + 0.5 * weights @ pushes, rtol=1e-14)
    np.testing.assert_allclose(position, 1.0 + 1.5 + 0.25 * weights @ (pushes * (1.0 - nodes)), rtol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_every_leaf_of_the_state_advances_by_its_own_slope(method: Method) -> None:
    state = {"a": jnp.zeros(2), "b": (jnp.ones(()),)}
    none = jnp.zeros(len(NODES[method]))
    after = runge_kutta.step(method, lambda y, _: {"a": jnp.ones(2), "b": (2.0 * jnp.ones(()),)}, state, none, 0.5)
    np.testing.assert_allclose(after["a"], [0.5, 0.5], rtol=1e-15)
    np.testing.assert_allclose(after["b"][0], 2.0, rtol=1e-15)


@pytest.mark.parametrize("method", METHODS)
def test_every_leaf_of_the_inputs_is_taken_at_the_methods_nodes(method: Method) -> None:
    nodes = jnp.asarray(NODES[method])
    inputs = {"rising": nodes, "vector": jnp.stack([nodes**2, nodes**3], axis=1)}
    state = {"x": jnp.zeros(()), "y": jnp.zeros(2)}
    after = runge_kutta.step(method, lambda _, u: {"x": u["rising"], "y": u["vector"]}, state, inputs, 1.0)
    np.testing.assert_allclose(after["x"], 0.5, rtol=1e-15)
    np.testing.assert_allclose(after["y"], [1 / 3, 1 / 4], rtol=1e-15)
