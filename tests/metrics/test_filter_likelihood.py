"""Surprises of the orbit filter, against log densities by scipy."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from rpojax.core.pytree import replace
from rpojax.flight.navigation.sensor_innovation import SensorInnovation
from rpojax.metrics import target_attitude
from rpojax.metrics.filter_likelihood import METRICS
from rpojax.metrics.metric_definition import Metric, WeightedValue

IMAGE_AREA = 128.0 * 96.0
INNOVATION = np.array([1.0, -2.0, 0.5, 0.01, -0.02, 0.3])
VARIANCE = np.array([4.0, 1.0, 0.25, 1e-4, 2e-4, 0.04])
BY_NORMAL = stats.norm.logpdf(INNOVATION, scale=np.sqrt(VARIANCE))
FALSE_SIZE = -np.log(3.0)
"""Log density of a false box's log size, over a range of 3."""
BY_NAME: dict[str, Metric] = {each.name: each for each in METRICS}


def surprise(
    used: bool, received: bool, truncated: bool, innovation: np.ndarray = INNOVATION, **others: SensorInnovation
) -> tuple[float, float]:
    """Innovation surprise with its weight; a box that is received is rejected, which does not matter."""
    sensors = {
        "gps": of_sensor(innovation[:3], VARIANCE[:3], [used] * 3),
        "box": replace(of_sensor(innovation[3:], VARIANCE[3:], [used] * 3), rejected=jnp.asarray(received)),
    }
    found = BY_NAME["innovation_surprise"].value(jnp, {**sensors, **others}, jnp.asarray(truncated), IMAGE_AREA)
    assert isinstance(found, WeightedValue)
    return float(found.value), float(found.weight)


def of_sensor(innovation: np.ndarray, variance: np.ndarray, used: list[bool]) -> SensorInnovation:
    no = jnp.asarray(False)
    return SensorInnovation(
        innovation=jnp.asarray(innovation),
        variance=jnp.asarray(variance),
        used=jnp.asarray(used),
        log_likelihood=jnp.zeros(()),
        accepted=no,
        rejected=no,
    )


def mixture(by_normal: np.ndarray, size: bool) -> float:
    """Log density of a box that is false once in twenty."""
    true = by_normal[3:5].sum() + by_normal[5] * size
    return float(np.log(0.95 * np.exp(true) + 0.05 * np.exp(FALSE_SIZE * size) / IMAGE_AREA))


@pytest.mark.parametrize("truncated", [False, True])
def test_the_innovation_surprise_is_minus_the_log_density_a_row(truncated: bool) -> None:
    gps, box, rows = BY_NORMAL[:3].sum(), mixture(BY_NORMAL, not truncated), 2 if truncated else 3
    np.testing.assert_allclose(surprise(True, True, truncated), (-(gps + box) / (3 + rows), 3 + rows), rtol=1e-6)
    np.testing.assert_allclose(surprise(False, True, truncated), (-box / rows, rows), rtol=1e-6)
    np.testing.assert_allclose(surprise(True, False, truncated), (-gps / 3, 3), rtol=1e-6)
    assert surprise(False, False, truncated) == (0.0, 0.0)


def test_rows_of_additional_sensors_count_like_those_of_gps() -> None:
    lidar = of_sensor(np.array([0.7, -3.0, 9.0]), np.array([0.5, 2.0, 1.0]), [True, True, False])
    expected = -stats.norm.logpdf([0.7, -3.0], scale=np.sqrt([0.5, 2.0])).sum() / 2.0
    np.testing.assert_allclose(surprise(False, False, False, lidar=lidar), (expected, 2.0), rtol=1e-6)


def test_a_box_far_off_surprises_no_more_than_a_false_one() -> None:
    far = np.where(np.arange(6) >= 3, 100.0, INNOVATION)
    expected = -(np.log(0.05) - np.log(IMAGE_AREA) + FALSE_SIZE) / 3.0
    np.testing.assert_allclose(surprise(False, True, False, far), (expected, 3.0), rtol=1e-6)


def test_the_estimate_surprise_is_minus_the_log_density_a_component() -> None:
    rng = np.random.default_rng(0)
    P = np.cov(rng.normal(size=(12, 40)))
    error = rng.normal(size=12)
    nees, log_determinant = error @ np.linalg.solve(P, error), np.linalg.slogdet(P)[1]
    found = BY_NAME["estimate_surprise"].value(np, nees, log_determinant)
    expected = -stats.multivariate_normal.logpdf(error, cov=P) / 12.0
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_the_pose_surprise_is_minus_the_log_density_a_component_while_the_attitude_is_known() -> None:
    rng = np.random.default_rng(1)
    P, error = np.cov(rng.normal(size=(6, 40))), rng.normal(size=6)
    nees, log_determinant = error @ np.linalg.solve(P, error), np.linalg.slogdet(P)[1]
    metric = {each.name: each for each in target_attitude.METRICS}["pose_surprise"]
    known = np.array([True, False])
    found = metric.value(np, np.array([nees, np.nan]), np.full(2, log_determinant), known)
    expected = -stats.multivariate_normal.logpdf(error, cov=P) / 6.0
    np.testing.assert_allclose(found.value, [expected, 0.0], rtol=1e-12)
    np.testing.assert_array_equal(found.weight, known)
