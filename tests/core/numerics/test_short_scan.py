"""A scan over a few passes, as a loop and unrolled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from rpojax.core.numerics.short_scan import short_scan


def passes(unrolled: bool | None, x: Array) -> Array:
    """A recurrence whose passes differ: their order counts."""
    return short_scan(lambda carry, row: (0.5 * carry * carry + row, None), x, jnp.arange(1.0, 5.0), unrolled=unrolled)


@pytest.mark.parametrize("unrolled", [False, True])
def test_loop_and_unrolled_passes_give_the_same_value_and_derivative(unrolled: bool) -> None:
    x = 0.3
    expected, slope = x, 1.0
    for row in (1.0, 2.0, 3.0, 4.0):
        expected, slope = 0.5 * expected**2 + row, slope * expected
    value, derivative = jax.jit(jax.value_and_grad(lambda x: passes(unrolled, x)))(jnp.array(x))
    np.testing.assert_allclose([value, derivative], [expected, slope], rtol=1e-14)


def test_a_cpu_has_a_loop_and_an_accelerator_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    x = jnp.array(0.3)

    def code() -> str:
        return jax.jit(lambda x: passes(None, x)).lower(x).as_text()

    assert "while" in code()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert "while" not in code()
