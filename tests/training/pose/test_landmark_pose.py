"""Poses from found landmarks, and the figures of an evaluation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import quaternion
from rpojax.training.pose.evaluate_landmarks import PictureResult, summary, table
from rpojax.training.pose.landmark_pose import landmark_pose
from rpojax.vision.landmark_network.find_landmarks import FoundLandmarks
from rpojax.vision.surface.landmark_file import load_landmarks

_FOCAL_PX, _CENTER_PX = jnp.float64(700.0), jnp.array([60.0, 80.0])
_LANDMARKS = load_landmarks()[0].positions
_pose = jax.jit(landmark_pose)


def _found(noise_px: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray, FoundLandmarks]:
    """Attitude, position, and all landmarks with noise, in single precision."""
    rng = np.random.default_rng(seed)
    attitude = rng.normal(size=4)
    attitude /= np.linalg.norm(attitude)
    position = np.array([0.4, -0.3, 6.0])
    seen = np.asarray(quaternion.to_matrix(jnp.asarray(attitude))) @ np.asarray(_LANDMARKS).T + position[:, None]
    places = np.asarray(_CENTER_PX)[:, None] + 700.0 * seen[:2] / seen[2]
    places = places.T + noise_px * rng.normal(size=places.T.shape)
    sigma = max(noise_px, 0.3)
    return (
        attitude,
        position,
        FoundLandmarks(
            places=jnp.asarray(places, jnp.float32),
            covariance=jnp.asarray(np.broadcast_to(sigma**2 * np.eye(2), (len(places), 2, 2)), jnp.float32),
            visible_probability=jnp.full(len(places), 0.9, jnp.float32),
        ),
    )


def _angle_deg(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.degrees(2.0 * np.arccos(min(1.0, abs(float(np.dot(first, second)))))))


def test_landmarks_without_errors_give_the_pose() -> None:
    attitude, position, found = _found(0.0)
    pose = _pose(_LANDMARKS, found, _FOCAL_PX, _CENTER_PX)
    assert bool(pose.exists)
    assert _angle_deg(np.asarray(pose.q_KT), attitude) < 0.01
    np.testing.assert_allclose(pose.r_TK_K, position, atol=1e-3)
    assert bool(pose.used.all())


def test_a_landmark_far_off_is_left_out() -> None:
    attitude, _, found = _found(0.5)
    moved = FoundLandmarks(**{**vars(found), "places": found.places.at[3].add(jnp.array([40.0, -25.0], jnp.float32))})
    pose = _pose(_LANDMARKS, moved, _FOCAL_PX, _CENTER_PX)
    assert np.flatnonzero(~np.asarray(pose.used)).tolist() == [3]
    assert _angle_deg(np.asarray(pose.q_KT), attitude) < 1.5


def test_landmarks_that_are_not_visible_do_not_count() -> None:
    attitude, _, found = _found(0.5)
    hidden = FoundLandmarks(
        **{
            **vars(found),
            "places": found.places.at[:8].add(30.0),
            "visible_probability": found.visible_probability.at[:8].set(0.1),
        }
    )
    pose = _pose(_LANDMARKS, hidden, _FOCAL_PX, _CENTER_PX)
    assert not np.asarray(pose.used)[:8].any()
    assert _angle_deg(np.asarray(pose.q_KT), attitude) < 2.0
    none = FoundLandmarks(**{**vars(found), "visible_probability": jnp.zeros(len(_LANDMARKS), jnp.float32)})
    assert not bool(_pose(_LANDMARKS, none, _FOCAL_PX, _CENTER_PX).exists)


def _result(
    range_m: float, attitude_deg: float, light: str = "sunlit", has_pose: bool = True, before_port: bool = False
) -> PictureResult:
    squares = np.random.default_rng(int(1e3 * range_m)).chisquare(2, 12 if has_pose else 0)
    sight = np.ones(len(squares), bool)
    return PictureResult(
        range_m, light, has_pose, attitude_deg, 0.01, np.sqrt(squares), squares, 10, sight, 9, before_port
    )


def test_figures_are_those_of_the_results() -> None:
    found = [_result(4.0 + 0.01 * i, float(i)) for i in range(101)]
    found += [_result(4.0, np.nan, has_pose=False) for _ in range(25)]
    figures = summary(found)
    assert figures["pictures"] == 126
    assert figures["without_pose"] == pytest.approx(25 / 126, abs=1e-4)
    assert figures["attitude_deg_median"] == 50.0
    assert figures["attitude_deg_p95"] == 95.0
    low, high = figures["attitude_deg_median_95"]
    assert 35.0 < low < 50.0 < high < 65.0
    assert figures["attitude_beyond_10_deg"] == pytest.approx(90 / 101, abs=1e-4)
    assert figures["translation_percent_median"] == pytest.approx(1.0)
    assert figures["landmark_nees_over_2_median"] == pytest.approx(1.0, abs=0.1)
    assert figures["landmark_nees_over_2_mean"] == pytest.approx(1.0, abs=0.1)
    assert figures["landmark_beyond_3_sigma"] == pytest.approx(np.exp(-4.5), abs=0.01)


def test_the_table_has_rows_of_ranges_and_lights() -> None:
    rows = table(
        [
            _result(2.0, 1.0),
            _result(1.5, 1.0, before_port=True),
            _result(5.0, 2.0, "lamp"),
            _result(18.0, 3.0, "shaded"),
        ]
    )
    shown = {(tuple(row["range_m"]), row["light"]): row["pictures"] for row in rows}
    assert shown[(1.2, 3.0), "all"] == shown[(1.2, 3.0), "sunlit"] == 2
    assert shown[(1.2, 2.0), "at port"] == 1
    assert shown[(3.0, 15.0), "lamp"] == 1
    assert ((3.0, 8.0), "shaded") not in shown
    assert shown[(8.0, 20.0), "shaded"] == shown[(15.0, 30.0), "all"] == 1
