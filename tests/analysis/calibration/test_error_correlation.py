"""The fit of the correlation of errors finds known shares and decay angles."""

import functools

import numpy as np
import pytest

from rpojax.analysis.calibration import camera_fit
from rpojax.analysis.calibration.camera_fit import FRAMES, fit_camera
from rpojax.analysis.calibration.detection_outcomes import DetectionOutcomes
from rpojax.scenario.loading import scenario_loader
from rpojax.sensors.statistical_camera import WIDE_SIGMA_FACTOR, CameraStatistics
from rpojax.sensors.view_features import FEATURE_COUNT

SIDE = 30.0
SIGMA = 0.04
COUNT = 400


def sequences(share: float, angle: float, turn: np.ndarray, wide: float = 0.0) -> DetectionOutcomes:
    """Boxes with correlated and independent errors, some three times as wide; two sides correlate by half."""
    rng = np.random.default_rng(5)
    lasting = rng.normal(size=(len(turn), 4))
    errors = []
    for _ in range(FRAMES):
        width = np.where(rng.random((len(turn), 1)) < wide, WIDE_SIGMA_FACTOR, 1.0)
        errors.append(width * (np.sqrt(share) * lasting + np.sqrt(1.0 - share) * rng.normal(size=lasting.shape)))
        kept = np.exp(-turn / angle)[:, None]
        lasting = kept * lasting + np.sqrt(1.0 - kept**2) * rng.normal(size=lasting.shape)
    error = np.stack(errors, axis=1).reshape(-1, 4)
    error[:, 2] = 0.5 * error[:, 0] + np.sqrt(0.75) * error[:, 2]
    outline = np.tile([40.0, 40.0, 40.0 + SIDE, 40.0 + SIDE], (len(error), 1))
    score = np.where(rng.random(len(error)) < 0.05, 0.1, 0.9)
    features = rng.normal(size=(len(error), FEATURE_COUNT))
    edges, inside = outline + SIDE * SIGMA * error, np.ones(len(error), bool)
    return DetectionOutcomes(features=features, outline=outline, in_frame=inside, edges=edges, score=score)


@functools.cache
def fitted(wide: float) -> CameraStatistics:
    """Camera fitted to errors of a frame: their distribution depends neither on the share nor on the angle."""
    turn = np.radians(np.random.default_rng(1).uniform(0.1, 3.0, COUNT))
    return fit_camera(sequences(0.5, np.radians(5.0), turn, wide), 0.4).statistics


def frame_correlation(share: float, wide: float) -> float:
    """Correlation of two frames of a target that does not turn: the width is drawn in each of them."""
    return share * (1.0 + 2.0 * wide) ** 2 / (1.0 + 8.0 * wide)


@pytest.mark.parametrize(("share", "angle_deg", "wide"), [(0.85, 10.0, 0.0), (0.4, 3.0, 0.0), (0.7, 8.0, 0.08)])
def test_the_share_and_the_angle_are_found(share: float, angle_deg: float, wide: float) -> None:
    turn = np.radians(np.random.default_rng(1).uniform(0.1, 3.0, COUNT))
    made = sequences(share, np.radians(angle_deg), turn, wide)
    found = camera_fit.with_error_correlation(fitted(wide), made, turn, 0.4)
    drawn = frame_correlation(float(found.lasting_share), float(found.wide_share))
    assert drawn == pytest.approx(frame_correlation(share, wide), abs=0.06)
    assert np.degrees(float(found.lasting_angle)) == pytest.approx(angle_deg, rel=0.2)
    correlation = np.asarray(found.mixing @ found.mixing.T)
    assert correlation[0, 2] == pytest.approx(0.5, abs=0.1)
    assert abs(correlation[0, 1]) < 0.1


def test_uncorrelated_errors_have_no_share() -> None:
    turn = np.radians(np.random.default_rng(1).uniform(0.05, 3.0, COUNT))
    made = sequences(0.0, 1.0, turn)
    assert float(camera_fit.with_error_correlation(fitted(0.0), made, turn, 0.4).lasting_share) < 0.06


def test_a_sequence_turns_by_equal_angles_and_nothing_else_changes() -> None:
    made = camera_fit.sample_tumble_sequences(scenario_loader.load("inspection"), 6, seed=3)
    q = made.views.q_TN.reshape(6, FRAMES, 4)
    # The first component of the rotation from one attitude to the next is the product of their quaternions.
    half_cosine = np.minimum(1.0, np.abs(np.sum(q[:, 1:] * q[:, :-1], axis=2)))
    expected = np.broadcast_to(made.turn_per_frame[:, None], half_cosine.shape)
    np.testing.assert_allclose(2.0 * np.arccos(half_cosine), expected, rtol=1e-6, atol=1e-7)
    for name in ("r_ST_N", "q_KN", "sun_N", "place_N", "earth_turn"):
        rows = getattr(made.views, name).reshape(6, FRAMES, -1)
        np.testing.assert_array_equal(rows, np.broadcast_to(rows[:, :1], rows.shape))
