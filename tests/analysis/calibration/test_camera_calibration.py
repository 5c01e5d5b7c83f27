"""The fit of the statistical camera finds a law that is known, and views are drawn as a camera can have them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.analysis.calibration import camera_calibration
from rpojax.analysis.calibration.camera_calibration import DetectionOutcomes
from rpojax.core import quaternion
from rpojax.scenario import scenario_file
from rpojax.sensors import statistical_camera
from rpojax.sensors.statistical_camera import FEATURE_COUNT

COUNT = 8000
SIDE = 30.0
SIGMA = 0.04


def known(seed: int) -> DetectionOutcomes:
    """Outcomes of a law: misses and bias depend on the first two features, one box in thirty is false."""
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(COUNT, FEATURE_COUNT))
    outline = np.tile([40.0, 40.0, 40.0 + SIDE, 40.0 + SIDE], (COUNT, 1))
    seen = rng.random(COUNT) < probability(features)
    false = rng.random(COUNT) < 1.0 / 30.0
    error = SIDE * (bias(features)[:, None] + SIGMA * rng.normal(size=(COUNT, 4)))
    edges = np.where(false[:, None], [90.0, 90.0, 100.0, 99.0], outline + error)
    score = np.where(seen | false, 0.9 + 0.02 * rng.normal(size=COUNT), 0.1)
    return DetectionOutcomes(features, outline, np.ones(COUNT, bool), edges, score)


def probability(features: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-2.0 - 2.0 * features[:, 0]))


def bias(features: np.ndarray) -> np.ndarray:
    return 0.08 * np.tanh(features[:, 1])


def test_the_fit_finds_the_law_behind_the_outcomes() -> None:
    fit = camera_calibration.fit_camera(known(0), 0.4)
    features = np.random.default_rng(9).normal(size=(500, FEATURE_COUNT))
    yes = jnp.ones((), bool)
    found = jax.vmap(lambda row: statistical_camera.frame_distribution(fit.statistics, row, yes))(
        jnp.asarray(features, jnp.float32)
    )
    expected = probability(features) * (1.0 - 1.0 / 30.0)
    # 8000 outcomes leave some hundredths of doubt.
    assert np.mean(np.abs(np.exp(found.log_true) - expected)) < 0.04
    assert np.mean(np.exp(found.log_false)) == pytest.approx(1.0 / 30.0, abs=0.015)
    assert np.mean(np.abs(np.mean(np.asarray(found.bias), axis=1) - bias(features))) < 0.015
    assert np.median(np.exp(np.asarray(found.log_sigma))) == pytest.approx(SIGMA, rel=0.2)
    # What is drawn strays as the outcomes do: no share of wide errors where there are none.
    assert float(fit.statistics.wide_share) < 0.05
    # It is about as good on outcomes that it has not seen.
    assert fit.log_likelihood_held_out > fit.log_likelihood - 0.8


def test_drawn_views_are_lit_and_within_the_camera_limits() -> None:
    file = scenario_file.load("inspection")
    views = camera_calibration.sample_views(file, 400, seed=2)
    distance = np.linalg.norm(views.r_ST_N, axis=1)
    assert distance.min() >= 0.6 * 30.0
    assert distance.max() <= 1.5 * 50.0
    phase = np.degrees(np.arccos(np.sum(views.sun_N * views.r_ST_N, axis=1) / distance))
    assert phase.max() <= file.camera.phase_limit_deg
    height = np.sum(views.sun_N * views.place_N, axis=1)
    assert not ((height < 0.0) & (np.sum(views.place_N**2, axis=1) - height**2 < 1.0)).any()


def test_most_drawn_views_have_the_target_in_the_frame() -> None:
    views = camera_calibration.sample_views(scenario_file.load("inspection"), 300, seed=3)
    pairs = zip(views.q_KN, views.r_ST_N, strict=True)
    seen = np.stack([quaternion.rotate(jnp.asarray(q), jnp.asarray(-r)) for q, r in pairs])
    angle = np.degrees(np.arctan2(np.linalg.norm(seen[:, :2], axis=1), seen[:, 2]))
    assert 0.7 < (angle < 5.0).mean() < 1.0


def test_the_same_seed_draws_the_same_views() -> None:
    file = scenario_file.load("inspection")
    one, other, third = (camera_calibration.sample_views(file, 20, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.q_KN, other.q_KN)
    assert not np.array_equal(one.q_KN, third.q_KN)
