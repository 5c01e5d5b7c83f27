"""The fusion barrier is the identity in value and derivative."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core.numerics.fusion_barrier import fusion_barrier


def test_the_barrier_passes_values_and_derivatives() -> None:
    def kernel(x: jax.Array, runtime_value: jax.Array) -> jax.Array:
        stored = fusion_barrier({"a": x**2, "b": (3.0 * x,)}, runtime_value)
        return jnp.sum(stored["a"] + stored["b"][0])

    x = np.array([1.0, -2.0])
    for runtime_value in (0, 7):
        value, slope = jax.jit(jax.value_and_grad(kernel))(x, np.int32(runtime_value))
        np.testing.assert_allclose(value, 5.0 - 3.0, rtol=1e-15)
        np.testing.assert_allclose(slope, 2.0 * x + 3.0, rtol=1e-15)


def test_the_barrier_passes_a_batch() -> None:
    batch = np.arange(6.0).reshape(3, 2)
    found = jax.jit(jax.vmap(lambda x: fusion_barrier(x, jnp.zeros((), dtype=jnp.int32))))(batch)
    np.testing.assert_array_equal(found, batch)
