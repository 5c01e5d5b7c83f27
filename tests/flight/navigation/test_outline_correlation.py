"""Correlation time of the outline: slow and fast tumbles, noise, frames of any rate, gaps."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.flight.navigation import outline_correlation
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation

NOISE = 0.1
"""1 sigma of the log aspect ratio of a box."""


@partial(jax.jit, static_argnums=2)
def observe(log_aspects: jax.Array, used: jax.Array, dt: float) -> OutlineCorrelation:
    """State after frames `dt` apart."""

    def frame(state: OutlineCorrelation, inputs: tuple[jax.Array, jax.Array]) -> tuple[OutlineCorrelation, None]:
        after = outline_correlation.update(state, inputs[0], jnp.asarray(NOISE**2), inputs[1])
        return outline_correlation.elapse(after, dt), None

    return jax.lax.scan(frame, outline_correlation.initial(), (log_aspects, used))[0]


def correlation_time(
    rate_deg_s: float, dt: float = 1.0, duration: float = 3000.0, used_share: float = 1.0, seed: int = 0
) -> float:
    """Estimate after watching an outline that repeats every half turn."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, dt)
    log_aspects = 0.6 * np.sin(2.0 * np.deg2rad(rate_deg_s) * time + 0.3) + NOISE * rng.normal(size=len(time))
    used = rng.random(len(time)) < used_share
    return float(outline_correlation.correlation_time(observe(jnp.asarray(log_aspects), jnp.asarray(used), dt)))


def test_before_any_box_the_outline_is_taken_to_change_slowly() -> None:
    found = outline_correlation.correlation_time(outline_correlation.initial())
    np.testing.assert_allclose(found, 300.0, rtol=1e-12)


def test_a_faster_tumble_has_a_shorter_correlation_time() -> None:
    found = [correlation_time(rate) for rate in (5.0, 2.0, 1.0, 0.5, 0.1)]
    assert found == sorted(found)
    assert found[0] < 10.0
    assert 20.0 < found[2] < 50.0
    assert found[-1] > 200.0


def test_an_outline_that_stays_has_the_longest_correlation_time() -> None:
    assert correlation_time(0.0) > 300.0


@pytest.mark.parametrize("dt", [0.2, 5.0])
def test_the_estimate_does_not_depend_on_the_frame_rate(dt: float) -> None:
    np.testing.assert_allclose(correlation_time(1.0, dt=dt), correlation_time(1.0), rtol=0.35)


def test_missed_frames_change_little() -> None:
    np.testing.assert_allclose(correlation_time(1.0, used_share=0.5), correlation_time(1.0), rtol=0.25)


def test_it_has_that_of_a_gauss_markov_process() -> None:
    tau, rng, count = 60.0, np.random.default_rng(3), 6000
    kept, found = math.exp(-1.0 / tau), []
    for _ in range(12):
        values = [0.0]
        for normal in rng.normal(size=count - 1):
            values.append(kept * values[-1] + 0.4 * math.sqrt(1.0 - kept**2) * normal)
        log_aspects = jnp.asarray(np.array(values) + NOISE * rng.normal(size=count))
        state = observe(log_aspects, jnp.ones(count, dtype=bool), 1.0)
        found.append(float(outline_correlation.correlation_time(state)))
    # The prior has a fifteenth of the weight, and each estimate rests on 25 correlation times.
    np.testing.assert_allclose(np.median(found), tau, rtol=0.35)


def test_an_unused_box_changes_nothing() -> None:
    before = observe(jnp.linspace(0.0, 1.0, 50), jnp.ones(50, dtype=bool), 1.0)
    after = outline_correlation.update(before, jnp.asarray(3.0), jnp.asarray(0.01), jnp.asarray(False))
    jax.tree.map(np.testing.assert_array_equal, after, before)
