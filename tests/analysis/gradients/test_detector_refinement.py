"""Objective and verdict of a refinement, and what it refuses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.analysis.gradients import detector_refinement
from rpojax.analysis.gradients.detector_refinement import RefinementSettings


def test_the_objective_is_of_the_runs_that_have_both_metrics() -> None:
    metrics = jnp.array([[2.0, 0.5], [jnp.nan, 1.0], [3.0, jnp.nan], [4.0, -0.25], [9.0, 9.0]])
    mask = jnp.array([1.0, 1.0, 1.0, 1.0, 0.0])
    expected = (np.log(2.0) + 0.5 + np.log(4.0) - 0.25) / 2.0
    assert float(detector_refinement.objective(metrics, mask)) == pytest.approx(expected)
    gradient = jax.grad(detector_refinement.objective)(metrics, mask)
    np.testing.assert_allclose(gradient, [[0.25, 0.5], [0, 0], [0, 0], [0.125, 0.5], [0, 0]], atol=1e-12)


def test_smaller_errors_of_all_runs_are_better_and_chance_is_not() -> None:
    rng = np.random.default_rng(0)
    before = np.exp(rng.normal(size=40))
    better = detector_refinement.compare(before, 0.8 * before, (1, 1))
    assert better.is_better
    assert better.ratio == pytest.approx(0.8)
    assert better.p95[1] == pytest.approx(0.8 * better.p95[0])
    assert better.ratio_95 == pytest.approx((0.8, 0.8))
    assert not detector_refinement.compare(before, 0.8 * before, (1, 2)).is_better
    noise = np.exp(0.3 * rng.normal(size=40))
    noise /= np.exp(np.log(noise).mean()) * 1.001
    assert not detector_refinement.compare(before, noise * before, (0, 0)).is_better
    # Smaller in the mean, larger in the tail.
    tail = np.where(before >= np.quantile(before, 0.9), 1.5, 0.7) * before
    found = detector_refinement.compare(before, tail, (0, 0))
    assert found.ratio_95[1] < 1.0
    assert not found.is_better


def test_runs_without_an_error_before_or_after_have_no_part() -> None:
    before, after = np.array([1.0, np.nan, 2.0]), np.array([0.5, 1.0, np.nan])
    assert detector_refinement.compare(before, after, (1, 1)).runs == 1
    with pytest.raises(rpojax.RpojaxError, match=r"^unseen runs: found none with a navigation error"):
        detector_refinement.compare(before[1:], after[1:], (1, 1))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"runs": 0}, "^runs: found 0, expected at least 1$"),
        ({"steps": -1}, "^steps: found -1, expected at least 1$"),
        ({"rate": 0.0}, "^rate: found 0, expected a positive number$"),
        ({"temperature": float("nan")}, "^temperature: found nan, expected a positive number$"),
        ({"horizon_s": float("inf")}, "^horizon_s: found inf, expected a positive number$"),
    ],
)
def test_settings_out_of_range_are_refused_in_a_line(settings: dict[str, float], words: str) -> None:
    with pytest.raises(rpojax.RpojaxError, match=words):
        RefinementSettings(**settings)  # pyright: ignore[reportArgumentType]


def test_a_camera_without_a_detector_is_refused() -> None:
    with pytest.raises(rpojax.RpojaxError, match="'rendered', whose detector is refined"):
        detector_refinement.check(rpojax.load("inspection"))
