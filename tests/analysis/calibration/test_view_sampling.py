"""Random views are lit, within the limits of the camera, and reproducible."""

import jax.numpy as jnp
import numpy as np

from rpojax.analysis.calibration.detection_outcomes import sample_views
from rpojax.core import quaternion
from rpojax.scenario.loading import scenario_loader


def test_sampled_views_are_lit_and_within_the_camera_limits() -> None:
    file = scenario_loader.load("inspection")
    views = sample_views(file, 400, seed=2)
    distance = np.linalg.norm(views.r_ST_N, axis=1)
    assert distance.min() >= 0.6 * 30.0
    assert distance.max() <= 1.5 * 50.0
    phase = np.degrees(np.arccos(np.sum(views.sun_N * views.r_ST_N, axis=1) / distance))
    assert phase.max() <= file.camera.phase_limit_deg
    height = np.sum(views.sun_N * views.place_N, axis=1)
    assert not ((height < 0.0) & (np.sum(views.place_N**2, axis=1) - height**2 < 1.0)).any()


def test_most_sampled_views_have_the_target_in_the_frame() -> None:
    views = sample_views(scenario_loader.load("inspection"), 300, seed=3)
    pairs = zip(views.q_KN, views.r_ST_N, strict=True)
    r_TS_K = np.stack([quaternion.rotate(jnp.asarray(q), jnp.asarray(-r)) for q, r in pairs])
    angle = np.degrees(np.arctan2(np.linalg.norm(r_TS_K[:, :2], axis=1), r_TS_K[:, 2]))
    assert 0.7 < (angle < 5.0).mean() < 1.0


def test_the_same_seed_gives_the_same_views() -> None:
    file = scenario_loader.load("inspection")
    one, other, third = (sample_views(file, 20, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.q_KN, other.q_KN)
    assert not np.array_equal(one.q_KN, third.q_KN)
