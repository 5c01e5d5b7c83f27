"""Random streams: reproducible, separate, and independent of the batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpojax.core import random_streams
from rpojax.core.random_streams import Stream

fold_in = jax.jit(random_streams.fold_in)
normal = jax.jit(random_streams.normal, static_argnums=1)
uniform = jax.jit(random_streams.uniform, static_argnums=1)
normal_per_key = jax.jit(random_streams.normal_per_key, static_argnums=1)
fold_in_per_key = jax.jit(random_streams.fold_in_per_key)
select_keys = jax.jit(random_streams.select_keys, static_argnums=1)


def run_key(seed: int, run: int) -> np.ndarray:
    return np.asarray(fold_in(random_streams.master_key(seed), run))


def test_a_run_gets_the_same_numbers_alone_and_in_a_batch() -> None:
    runs = np.arange(5)

    def draws(run: jax.Array) -> tuple[jax.Array, jax.Array]:
        key = random_streams.fold_in(random_streams.fold_in(random_streams.master_key(3), run), Stream.GPS)
        return random_streams.normal(key, 6), random_streams.uniform(key, 6)

    batch = jax.jit(jax.vmap(draws))(runs)
    for run in range(5):
        for together, alone in zip(batch, jax.jit(draws)(runs[run]), strict=True):
            np.testing.assert_array_equal(np.asarray(together)[run], alone)


def test_keys_differ_between_seeds_runs_and_streams() -> None:
    keys = [
        tuple(np.asarray(fold_in(run_key(seed, run), stream)).tolist())
        for seed in (0, 1)
        for run in (0, 1, 2)
        for stream in Stream
    ]
    assert len(set(keys)) == len(keys)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 7, 40]))
def test_keys_and_numbers_are_those_of_jax(seed: int, number: int, count: int) -> None:
    theirs = jax.random.fold_in(jax.random.key(seed, impl="threefry2x32"), np.uint32(number))
    key = fold_in(random_streams.master_key(seed), np.uint32(number))
    np.testing.assert_array_equal(key, jax.random.key_data(theirs))
    np.testing.assert_array_equal(normal(key, count), jax.random.normal(theirs, (count,), dtype=jnp.float32))
    np.testing.assert_array_equal(uniform(key, count), jax.random.uniform(theirs, (count,), dtype=jnp.float32))


def test_batched_keys_and_numbers_equal_those_of_each_key() -> None:
    keys = np.stack([run_key(7, run) for run in range(4)])
    chosen = (3, 0, 0)
    derived = fold_in_per_key(select_keys(keys, chosen), np.array([9, 5, 2**31], dtype=np.uint32))
    expected = [
        fold_in(keys[3], 9),
        fold_in(keys[0], 5),
        fold_in(keys[0], np.uint32(2**31)),
    ]
    np.testing.assert_array_equal(derived, np.stack(expected))
    counts = (3, 0, 8, 1)
    expected = [normal(key, count) for key, count in zip(keys, counts, strict=True)]
    np.testing.assert_array_equal(normal_per_key(keys, counts), np.concatenate(expected))


def test_each_key_needs_its_count() -> None:
    keys = jnp.zeros((3, 2), dtype=jnp.uint32)
    for counts in ([3], [2, 2], [1, 1, 1, 1]):
        with pytest.raises(ValueError, match=f"counts: found {len(counts)}, expected one for each of 3 keys"):
            random_streams.normal_per_key(keys, counts)


def test_the_key_of_a_run_is_pinned() -> None:
    # Numbers of threefry: a change would silently change all stored results.
    assert run_key(1, 0).tolist() == [507451445, 1853169794]
    np.testing.assert_allclose(normal(run_key(1, 0), 3), [0.53193736, -0.72301704, 0.90725702], rtol=1e-6)


def test_the_numbers_of_the_first_streams_are_pinned() -> None:
    names = ["DISPERSION", "HANDOVER", "GPS", "STAR_TRACKER", "GYRO", "BOX_CAMERA", "THRUSTER", "SENSOR_BIAS"]
    assert [Stream[name].value for name in names] == list(range(1, 9))


def test_normal_numbers_are_standard_normal_in_double_precision() -> None:
    x = np.asarray(normal(run_key(5, 0), 40_000))
    assert x.dtype == np.float64
    # Four sigma of each statistic over 40000 numbers.
    assert abs(x.mean()) < 4 / 200
    assert abs(x.var() - 1.0) < 4 * np.sqrt(2) / 200
    assert abs((x**4).mean() - 3.0) < 4 * np.sqrt(96) / 200
    assert abs((x[1:] * x[:-1]).mean()) < 4 / 200


def test_uniform_numbers_fill_the_unit_interval_in_double_precision() -> None:
    x = np.asarray(uniform(run_key(5, 1), 40_000))
    assert x.dtype == np.float64
    assert x.min() >= 0.0
    assert x.max() < 1.0
    counts = np.histogram(x, bins=20, range=(0.0, 1.0))[0]
    assert np.max(np.abs(counts - 2000.0)) < 4 * np.sqrt(2000)
