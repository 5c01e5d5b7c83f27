"""Safe primitives: values at regular points, defined values and finite derivatives at singular points."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS

from rpojax.core.numerics import gradient_safe

gate = jax.jit(gradient_safe.gate)
gate_slopes = jax.jit(jax.grad(gradient_safe.gate, argnums=(0, 1)))
is_finite = jax.jit(gradient_safe.is_finite)


@given(SEEDS)
def test_values_at_regular_points_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    v, x, y = rng.normal(size=3), *rng.uniform(0.1, 0.9, 2)
    np.testing.assert_allclose(gradient_safe.norm(jnp.asarray(v)), np.linalg.norm(v), rtol=1e-15)
    np.testing.assert_allclose(gradient_safe.normalize(jnp.asarray(v)), v / np.linalg.norm(v), rtol=1e-14)
    np.testing.assert_allclose(gradient_safe.sqrt(jnp.asarray(x)), np.sqrt(x), rtol=1e-15)
    np.testing.assert_allclose(gradient_safe.safe_div(jnp.asarray(x), jnp.asarray(-y)), -x / y, rtol=1e-15)


SINGULAR_POINTS: list[tuple[str, Callable[..., jax.Array], tuple[float | list[float], ...], float | list[float]]] = [
    ("norm of zero", gradient_safe.norm, ([0.0, 0.0, 0.0],), 0.0),
    ("root of zero", gradient_safe.sqrt, (0.0,), 0.0),
    ("root of a negative", gradient_safe.sqrt, (-2.0,), 0.0),
    ("direction of zero", gradient_safe.normalize, ([0.0, 0.0, 0.0],), [0.0, 0.0, 0.0]),
    ("division by zero", gradient_safe.safe_div, (3.0, 0.0), 0.0),
    ("zero by zero", gradient_safe.safe_div, (0.0, 0.0), 0.0),
]


@pytest.mark.parametrize(("function", "arguments", "value"), [case[1:] for case in SINGULAR_POINTS],
                         ids=[case[0] for case in SINGULAR_POINTS])  # fmt: skip
def test_singular_points_have_a_defined_value_and_zero_derivative_in_both_modes(
    function: Callable[..., jax.Array], arguments: tuple[float | list[float], ...], value: float | list[float]
) -> None:
    arrays = tuple(jnp.asarray(argument) for argument in arguments)
    every = tuple(range(len(arrays)))
    np.testing.assert_array_equal(function(*arrays), value)
    for mode in (jax.jacfwd, jax.jacrev):
        for slope in mode(function, argnums=every)(*arrays):
            np.testing.assert_array_equal(slope, np.zeros_like(slope))


def test_the_gate_is_a_hard_step_in_value() -> None:
    margins = [-1e9, -1e-12, 0.0, 1e-12, 1e9]
    values = [float(gate(np.float64(margin), np.float64(0.1))) for margin in margins]
    assert values == [0.0, 0.0, 0.0, 1.0, 1.0]


@pytest.mark.parametrize("margin", [-0.3, 0.0, 0.02, 0.5])
def test_the_gate_has_the_derivative_of_a_logistic_step_of_its_width(margin: float) -> None:
    width, h = 0.1, 1e-6

    def logistic(x: float) -> float:
        return 1.0 / (1.0 + np.exp(-x / width))

    to_margin, to_width = gate_slopes(np.float64(margin), np.float64(width))
    expected = (logistic(margin + h) - logistic(margin - h)) / (2 * h)
    np.testing.assert_allclose(to_margin, expected, rtol=1e-7)
    assert to_width == 0.0


@pytest.mark.parametrize("margin", [-1e6, 0.0, 1e-9])
def test_the_gate_of_infinite_width_is_a_step_in_its_derivative_too(margin: float) -> None:
    assert tuple(gate_slopes(np.float64(margin), np.float64(np.inf))) == (0.0, 0.0)


@pytest.mark.parametrize("margin", [-1e6, 1e6])
def test_the_gate_is_flat_far_from_its_threshold(margin: float) -> None:
    assert gate_slopes(np.float64(margin), np.float64(0.1))[0] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_nonfinite_number_makes_a_tree_not_finite(bad: float) -> None:
    good = {"a": np.array([1.0, -1e300]), "b": (np.array(3), np.array(True)), "c": np.array(0.0)}
    assert is_finite(good)
    assert not is_finite({**good, "a": np.array([1.0, bad])})
    assert not is_finite({**good, "c": np.array(bad)})
