"""The fit of landmark statistics finds what made its outcomes: shares, errors, the turn of false pictures, decay."""

import functools

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpojax.analysis.calibration import landmark_fit
from rpojax.analysis.calibration.camera_fit import FRAMES
from rpojax.analysis.calibration.detection_outcomes import DetectionOutcomes, LandmarkOutcomes
from rpojax.core.pytree import replace
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.trained import target_landmarks
from rpojax.sensors.statistical_landmarks import landmark_distribution
from rpojax.sensors.view_features import FEATURE_COUNT
from rpojax.vision.surface.landmarks import Landmarks

THRESHOLD, RANGE_M = 0.4, 15.0
SIGMA_PX, SCALE, FALSE = 0.8, 0.7, 0.08
TURN = Rotation.from_rotvec(np.radians(70.0) * np.array([2.0, -1.0, 2.0]) / 3.0)
SEQUENCES, SHARE, ANGLE_DEG = 100, 0.8, 12.0


@functools.cache
def landmarks() -> Landmarks:
    found = target_landmarks.landmarks_for_camera(scenario_loader.load("pose_inspection").model_dump())
    assert found is not None
    return found


@functools.cache
def outcomes(false: float = FALSE) -> tuple[DetectionOutcomes, np.ndarray]:
    """Landmarks of sequences of a target that turns, and the turn between frames [rad].

    Even landmarks are in sight where the first feature is above zero, odd ones where the second is.
    """
    rng, camera = np.random.default_rng(3), scenario_loader.load("pose_inspection").camera
    points = np.array(landmarks().positions)
    count, turn = len(points), np.radians(rng.uniform(0.2, 6.0, SEQUENCES))
    lasting = rng.normal(size=(SEQUENCES, count, 2))
    errors = []
    for _ in range(FRAMES):
        errors.append(np.sqrt(SHARE) * lasting + np.sqrt(1.0 - SHARE) * rng.normal(size=lasting.shape))
        kept = np.exp(-turn / np.radians(ANGLE_DEG))[:, None, None]
        lasting = kept * lasting + np.sqrt(1.0 - kept**2) * rng.normal(size=lasting.shape)
    error = np.stack(errors, axis=1).reshape(-1, count, 2)
    total = len(error)
    attitudes = Rotation.random(total, rng=rng).as_matrix()
    focal = 0.5 * camera.width_px / np.tan(np.radians(0.5 * camera.field_of_view_deg))
    is_false = np.repeat(rng.random(SEQUENCES) < false, FRAMES)

    def places(shown: np.ndarray) -> np.ndarray:
        seen = shown @ attitudes.transpose(0, 2, 1) + np.array([0.0, 0.0, RANGE_M])
        return 0.5 * camera.width_px + focal * seen[:, :, :2] / seen[:, :, 2:]

    true = places(np.tile(points, (total, 1, 1)))
    shown = np.where(is_false[:, None, None], places(np.tile(TURN.apply(points), (total, 1, 1))), true)
    features = rng.normal(size=(total, FEATURE_COUNT))
    sight = np.where(features[:, np.arange(count) % 2] > 0.0, 0.9, 0.1)
    box = np.tile([100.0, 100.0, 150.0, 150.0], (total, 1))
    found = LandmarkOutcomes(
        places=shown + SCALE * SIGMA_PX * error,
        sigma=np.full((total, count), SIGMA_PX),
        probability=sight,
        true_places=true,
        R_KT=attitudes,
    )
    seen = DetectionOutcomes(
        features=features,
        outline=box,
        in_frame=np.ones(total, bool),
        edges=box,
        score=np.where(rng.random(total) < 0.05, 0.1, 0.9),
        landmarks=found,
    )
    return seen, turn


def test_the_fit_finds_what_made_the_landmarks() -> None:
    seen, turn = outcomes()
    camera = scenario_loader.load("pose_inspection").camera
    found, figures = landmark_fit.fit_landmarks(seen, landmarks(), camera, THRESHOLD)
    found = landmark_fit.with_landmark_correlation(found, seen, turn, THRESHOLD)
    assert abs(np.dot(np.asarray(found.false_turn), np.roll(TURN.as_quat(), 1))) == pytest.approx(1.0, abs=1e-3)
    assert figures["false_turn_deg"] == pytest.approx(70.0, abs=2.0)
    assert 0.02 < figures["false_pictures"] < 0.2
    assert float(found.error_scale) == pytest.approx(SCALE, rel=0.1)
    assert float(found.lasting_share) == pytest.approx(SHARE, abs=0.06)
    assert np.degrees(float(found.lasting_angle)) == pytest.approx(ANGLE_DEG, rel=0.25)
    bright = landmark_distribution(found, jnp.zeros(FEATURE_COUNT, jnp.float32).at[0].set(1.5))
    dark = landmark_distribution(found, jnp.zeros(FEATURE_COUNT, jnp.float32).at[0].set(-1.5))
    assert float(bright.found_logit[::2].min()) > 1.5
    assert float(dark.found_logit[::2].max()) < -1.5
    np.testing.assert_allclose(np.exp(bright.log_sigma), SIGMA_PX / 50.0, rtol=0.1)


def test_without_false_pictures_there_is_no_turn() -> None:
    seen, _ = outcomes(0.0)
    few = replace(seen, score=np.where(np.arange(len(seen.score)) < 400, seen.score, 0.0))
    camera = scenario_loader.load("pose_inspection").camera
    found, figures = landmark_fit.fit_landmarks(few, landmarks(), camera, THRESHOLD)
    assert figures["false_pictures"] == 0.0
    np.testing.assert_array_equal(found.false_turn, [1.0, 0.0, 0.0, 0.0])
