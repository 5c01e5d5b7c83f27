"""Statistical camera: frames follow the fitted distribution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic_camera_statistics import MIXING, fitted, scene

from rpojax.sensors import statistical_camera
from rpojax.sensors.camera import CameraFrame
from rpojax.sensors.statistical_camera import NORMALS_PER_FRAME, UNIFORMS_PER_FRAME, CameraStatistics

SIZE = (128, 128)
DRAWS = 20_000
OUTLINE = np.array([40.0, 50.0, 80.0, 74.0], np.float32)  # 40 x 24 px, geometric mean 31 px
MEAN_SIDE = np.sqrt(40.0 * 24.0)


def drawn(statistics: CameraStatistics, outline: np.ndarray = OUTLINE, light: bool = True) -> CameraFrame:
    """Many frames of one view."""
    key = jax.random.key(3)
    normals = jax.random.normal(key, (DRAWS, NORMALS_PER_FRAME))
    lasting = jax.random.normal(jax.random.fold_in(key, 2), (DRAWS, 4))
    uniforms = jax.random.uniform(jax.random.fold_in(key, 1), (DRAWS, UNIFORMS_PER_FRAME))
    yes = jnp.asarray(True)

    def one(lasting: jax.Array, normals: jax.Array, uniforms: jax.Array) -> CameraFrame:
        return statistical_camera.measure(
            statistics, scene(), jnp.asarray(outline), yes, SIZE, jnp.asarray(light), yes, lasting, normals, uniforms
        )

    return jax.jit(jax.vmap(one))(lasting, normals, uniforms)


def sigma() -> float:
    """1 sigma [px] of edges where the network says zero."""
    low, high = -5.5, 0.0
    return float(MEAN_SIDE * np.exp(low + (high - low) / (1.0 + np.exp(-4.0 * (-3.0 + 2.75) / 5.5))))


def test_the_frequency_of_boxes_follows_the_distribution() -> None:
    frame = drawn(fitted(true=0.8, false=0.05))
    true = np.asarray(frame.box.present & ~frame.outlier)
    # Four sigma of so many draws.
    assert true.mean() == pytest.approx(0.8, abs=4.0 * np.sqrt(0.16 / DRAWS))
    assert np.asarray(frame.outlier).mean() == pytest.approx(0.05, abs=4.0 * np.sqrt(0.0475 / DRAWS))


def test_edge_errors_have_the_bias_and_the_spread_of_the_distribution() -> None:
    frame = drawn(fitted(true=0.999, false=0.0, bias=0.05))
    error = np.asarray(frame.box.edges)[np.asarray(frame.box.present)] - OUTLINE
    np.testing.assert_allclose(error.mean(axis=0), 0.05 * MEAN_SIDE, atol=5.0 * sigma() / np.sqrt(DRAWS))
    np.testing.assert_allclose(error.std(axis=0), sigma(), rtol=0.03)


def test_edge_errors_have_the_fitted_correlation() -> None:
    frame = drawn(fitted(true=0.999, false=0.0))
    error = np.asarray(frame.box.edges)[np.asarray(frame.box.present)] - OUTLINE
    np.testing.assert_allclose(np.corrcoef(error.T), MIXING @ MIXING.T, atol=0.03)


def test_the_correlated_error_is_stationary_and_decays_with_the_angle() -> None:
    statistics = fitted(true=0.9, false=0.0)
    before, normals = np.random.default_rng(4).normal(size=(2, DRAWS, 4))
    advance = jax.jit(
        jax.vmap(lambda e, n: statistical_camera.advance_correlated_error(statistics, e, jnp.asarray(0.1), n))
    )
    after = np.asarray(advance(before, normals))
    assert after.std() == pytest.approx(1.0, abs=0.01)
    assert np.mean(after * before) == pytest.approx(np.exp(-0.1 / 0.2), abs=0.01)
    still = statistical_camera.advance_correlated_error(
        statistics, jnp.asarray(before[0]), jnp.asarray(0.0), jnp.asarray(normals[0])
    )
    np.testing.assert_array_equal(still, before[0])


def test_false_boxes_have_scores_of_their_own() -> None:
    frame = drawn(fitted(true=0.5, false=0.3))
    score, false = np.asarray(frame.score), np.asarray(frame.outlier)
    logit = np.log(score[false] / (1.0 - score[false]))
    assert (logit.mean(), logit.std()) == (pytest.approx(0.5, abs=0.01), pytest.approx(0.1, rel=0.05))


def test_a_fraction_of_the_boxes_has_wide_errors() -> None:
    frame = drawn(fitted(true=0.999, false=0.0, wide=0.2))
    error = np.asarray(frame.box.edges)[np.asarray(frame.box.present)] - OUTLINE
    expected = sigma() * np.sqrt(0.8 + 0.2 * statistical_camera.WIDE_SIGMA_FACTOR**2)
    np.testing.assert_allclose(error.std(axis=0), expected, rtol=0.04)


def test_a_target_outside_of_the_frame_has_no_box_of_its_own() -> None:
    frame = drawn(fitted(true=0.9, false=0.02), outline=OUTLINE + np.float32(200.0))
    np.testing.assert_array_equal(np.asarray(frame.box.present), np.asarray(frame.outlier))
    assert 0.0 < np.asarray(frame.outlier).mean() < 0.3


def test_without_light_there_is_no_box() -> None:
    frame = drawn(fitted(true=0.9, false=0.05), light=False)
    assert not np.asarray(frame.box.present).any()
    assert not np.asarray(frame.observable).any()


def test_boxes_stay_in_the_frame_and_those_at_its_border_are_truncated() -> None:
    outline = np.array([-20.0, 30.0, 20.0, 54.0], np.float32)
    frame = drawn(fitted(true=0.999, false=0.0), outline=outline)
    edges = np.asarray(frame.box.edges)[np.asarray(frame.box.present)]
    assert edges.min() >= 0.0
    assert edges.max() <= 128.0
    cut = np.asarray(frame.box.truncated)[np.asarray(frame.box.present)]
    np.testing.assert_array_equal(cut, edges[:, 0] < 1.0)
    assert 0.2 < cut.mean() <= 1.0
