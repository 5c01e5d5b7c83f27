"""The rules of finite differences, each against the difference of two values in fifty digits."""

from collections.abc import Callable
from decimal import Decimal, localcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import SEEDS, random_unit

from rpojax.core.numerics.exact_difference import Difference, inverse_norm

EXACT = 1e-14  # a few roundings, although the two values may agree in all sixteen digits

inverse = jax.jit(inverse_norm)

RULES: dict[str, Callable] = {
    "a + b": lambda a, b: a + b,
    "a - b": lambda a, b: a - b,
    "a * b": lambda a, b: a * b,
    "a + 2": lambda a, _: a + type(a)(2) if isinstance(a, Decimal) else a + 2.0,
    "a - 2": lambda a, _: a - type(a)(2) if isinstance(a, Decimal) else a - 2.0,
    "3 a": lambda a, _: a * type(a)(3) if isinstance(a, Decimal) else a * 3.0,
    "a b a - b": lambda a, b: a * b * a - b,
}


def number(value: float, change: float) -> Difference:
    return Difference(value=jnp.float64(value), change=jnp.float64(change))


def exact(rule: Callable, points: list[Difference]) -> tuple[float, float]:
    """Value and change by a rule in fifty digits."""
    with localcontext(prec=50):
        first = [Decimal(float(p.value)) for p in points]
        second = [x + Decimal(float(p.change)) for x, p in zip(first, points, strict=True)]
        return float(rule(*first)), float(rule(*second) - rule(*first))


@pytest.mark.parametrize("name", RULES)
@given(SEEDS, st.floats(-12.0, 1.0))
def test_each_rule_gives_value_and_change_to_full_relative_precision(name: str, seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    # Values and changes are positive, so that no sum cancels.
    points = [number(v, c) for v, c in zip(rng.uniform(3.0, 5.0, 2), 10.0**power * rng.uniform(1, 2, 2), strict=True)]
    if "-" in name:
        points[1] = number(float(points[1].value) / 8.0, float(points[1].change) / 8.0)
    value, change = exact(RULES[name], points)
    found = RULES[name](*points)
    np.testing.assert_allclose(found.value, value, rtol=EXACT)
    np.testing.assert_allclose(found.change, change, rtol=EXACT)


@given(SEEDS, st.floats(-3.0, 6.0))
def test_the_inverse_norm_and_its_change_are_exact_from_a_millimetre_to_a_thousand_kilometres(
    seed: int, power: float
) -> None:
    rng = np.random.default_rng(seed)
    r = rng.uniform(6.6e6, 4.2e7) * random_unit(rng)
    d = 10.0**power * random_unit(rng)
    d = d if abs(d @ r) > 0.1 * np.linalg.norm(d) * np.linalg.norm(r) else 10.0**power * r / np.linalg.norm(r)
    found = inverse(Difference(value=r, change=d))
    with localcontext(prec=50):
        near = [Decimal(float(x)) for x in r]
        far = [x + Decimal(float(y)) for x, y in zip(near, d, strict=True)]
        lengths = [sum(x * x for x in place).sqrt() for place in (near, far)]
        value, change = float(1 / lengths[0]), float(1 / lengths[1] - 1 / lengths[0])
    np.testing.assert_allclose(found.value, value, rtol=EXACT)
    # Perpendicular to the position the change cancels to first order; 6 deg from there 12 digits remain.
    np.testing.assert_allclose(found.change, change, rtol=1e-12)


def test_a_scalar_scales_a_vector_at_both_ends() -> None:
    vector = Difference(value=jnp.array([1.0, 2.0, 3.0]), change=jnp.array([0.5, 0.0, -1.0]))
    found = number(2.0, 1.0).scale(vector)
    np.testing.assert_array_equal(found.value, [2.0, 4.0, 6.0])
    np.testing.assert_array_equal(found.value + found.change, [4.5, 6.0, 6.0])


def test_a_component_keeps_its_value_and_its_change() -> None:
    vector = Difference(value=jnp.array([1.0, 2.0, 3.0]), change=jnp.array([0.5, 0.0, -1.0]))
    assert (float(vector[2].value), float(vector[2].change)) == (3.0, -1.0)


def test_zero_distance_gives_zero_change() -> None:
    none = Difference(value=jnp.array([1e7, 2e6, 3e6]), change=jnp.zeros(3))
    length = inverse(none)
    assert float((length * length * length).change) == 0.0
    np.testing.assert_array_equal(length.scale(none).change, np.zeros(3))
