"""The fit of the statistical camera to outcomes of a known distribution."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.analysis.calibration.camera_fit import fit_camera, outcome_summary
from rpojax.analysis.calibration.detection_outcomes import DetectionOutcomes
from rpojax.sensors import statistical_camera
from rpojax.sensors.view_features import FEATURE_COUNT

COUNT = 8000
SIDE = 30.0
SIGMA = 0.04


def known(seed: int) -> DetectionOutcomes:
    """Outcomes of a known distribution: misses and bias depend on two features, one box in thirty is false."""
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(COUNT, FEATURE_COUNT))
    outline = np.tile([40.0, 40.0, 40.0 + SIDE, 40.0 + SIDE], (COUNT, 1))
    seen = rng.random(COUNT) < probability(features)
    false = rng.random(COUNT) < 1.0 / 30.0
    error = SIDE * (bias(features)[:, None] + SIGMA * rng.normal(size=(COUNT, 4)))
    edges = np.where(false[:, None], [90.0, 90.0, 100.0, 99.0], outline + error)
    score = np.where(seen | false, 0.9 + 0.02 * rng.normal(size=COUNT), 0.1)
    return DetectionOutcomes(
        features=features, outline=outline, in_frame=np.ones(COUNT, bool), edges=edges, score=score
    )


def probability(features: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-2.0 - 2.0 * features[:, 0]))


def bias(features: np.ndarray) -> np.ndarray:
    return 0.08 * np.tanh(features[:, 1])


def test_a_detector_that_finds_nothing_has_no_accuracy() -> None:
    outlines, nothing = np.tile([40.0, 40.0, 70.0, 70.0], (3, 1)), np.zeros(3)
    missed = DetectionOutcomes(
        features=np.zeros((3, FEATURE_COUNT)),
        outline=outlines,
        in_frame=np.ones(3, bool),
        edges=outlines,
        score=nothing,
    )
    assert outcome_summary(missed, 0.4) == {
        "detected_in_frame": 0.0,
        "false_boxes": 0.0,
        "median_overlap": None,
        "edge_bias_px": None,
        "edge_sigma_px": None,
    }
    outside = replace(missed, in_frame=np.zeros(3, bool))
    assert outcome_summary(outside, 0.4)["detected_in_frame"] is None


def test_the_fit_finds_the_distribution_of_the_outcomes() -> None:
    fit = fit_camera(known(0), 0.4)
    features = np.random.default_rng(9).normal(size=(500, FEATURE_COUNT))
    yes = jnp.ones((), bool)
    found = jax.vmap(lambda row: statistical_camera.frame_distribution(fit.statistics, row, yes))(
        jnp.asarray(features, jnp.float32)
    )
    expected = probability(features) * (1.0 - 1.0 / 30.0)
    # 8000 outcomes leave an uncertainty of some hundredths.
    assert np.mean(np.abs(np.exp(found.log_true) - expected)) < 0.04
    assert np.mean(np.exp(found.log_false)) == pytest.approx(1.0 / 30.0, abs=0.015)
    assert np.mean(np.abs(np.mean(np.asarray(found.bias), axis=1) - bias(features))) < 0.015
    assert np.median(np.exp(np.asarray(found.log_sigma))) == pytest.approx(SIGMA, rel=0.2)
    # No share of wide errors where there are none.
    assert float(fit.statistics.wide_share) < 0.05
    # The held-out likelihood is about as good.
    assert fit.log_likelihood_held_out > fit.log_likelihood - 0.8
