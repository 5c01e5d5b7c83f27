"""The checkpointed scan against the plain one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.analysis.gradients.rollout_evaluator import checkpoint_interval, checkpointed_scan


@pytest.mark.parametrize(
    ("ticks", "runs", "memory", "expected"), [(2000, 32, 2e9, 1), (2000, 512, 2e9, 45), (4, 1, 1, 2)]
)
def test_all_states_are_kept_as_far_as_memory_goes(ticks: int, runs: int, memory: float, expected: int) -> None:
    assert checkpoint_interval(ticks, 4000, runs, int(memory)) == expected


@pytest.mark.parametrize("interval", [1, 3, 5, 7])
def test_any_interval_gives_the_same_derivative(interval: int) -> None:
    def last(x: jax.Array, interval: int) -> jax.Array:
        return checkpointed_scan(lambda carry: jnp.sin(carry * x) + 1.0, x, 17, interval)

    plain, kept = (jax.value_and_grad(last)(jnp.asarray(0.7), size) for size in (0, interval))
    np.testing.assert_allclose(kept, plain, rtol=1e-14)
