"""Statistical camera: frames follow the fitted distribution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic_camera_statistics import MIXING, fitted, scene

from rpojax.core.pytree import replace
from rpojax.sensors import statistical_camera
from rpojax.sensors.camera import CameraFrame
from rpojax.sensors.statistical_camera import NORMALS_PER_FRAME, UNIFORMS_PER_FRAME, CameraStatistics
from rpojax.sensors.view_features import FEATURE_COUNT

SIZE = (128, 128)
DRAWS = 20_000
OUTLINE = np.array([40.0, 50.0, 80.0, 74.0], np.float32)  # 40 x 24 px, geometric mean 31 px
MEAN_SIDE = np.sqrt(40.0 * 24.0)


def drawn(
    statistics: CameraStatistics, outline: np.ndarray = OUTLINE, light: bool = True, working: bool = True
) -> CameraFrame:
    """Many frames of one view."""
    key = jax.random.key(3)
    normals = jax.random.normal(key, (DRAWS, NORMALS_PER_FRAME))
    lasting = jax.random.normal(jax.random.fold_in(key, 2), (DRAWS, 4))
    uniforms = jax.random.uniform(jax.random.fold_in(key, 1), (DRAWS, UNIFORMS_PER_FRAME))
    yes = jnp.asarray(True)

    def one(lasting: jax.Array, normals: jax.Array, uniforms: jax.Array) -> CameraFrame:
        lit = (jnp.asarray(light), jnp.asarray(working))
        return statistical_camera.measure(
            statistics, scene(), jnp.asarray(outline), yes, SIZE, *lit, lasting, normals, uniforms
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
    kept = np.exp(-0.1 / 0.2)
    np.testing.assert_allclose(after, kept * before + np.sqrt(1.0 - kept**2) * normals, atol=1e-6)
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


@pytest.mark.parametrize(("light", "working"), [(False, True), (True, False)], ids=["in the dark", "failed"])
def test_without_light_or_with_a_failed_camera_there_is_no_box(light: bool, working: bool) -> None:
    frame = drawn(fitted(true=0.9, false=0.05), light=light, working=working)
    assert not np.asarray(frame.box.present).any()
    assert not np.asarray(frame.outlier).any()
    np.testing.assert_array_equal(frame.observable, light)


def test_boxes_stay_in_the_frame_and_those_at_its_border_are_truncated() -> None:
    outline = np.array([-20.0, 30.0, 20.0, 54.0], np.float32)
    frame = drawn(fitted(true=0.999, false=0.0), outline=outline)
    edges = np.asarray(frame.box.edges)[np.asarray(frame.box.present)]
    assert edges.min() >= 0.0
    assert edges.max() <= 128.0
    cut = np.asarray(frame.box.truncated)[np.asarray(frame.box.present)]
    np.testing.assert_array_equal(cut, edges[:, 0] < 1.0)
    assert 0.2 < cut.mean() <= 1.0


def test_the_distribution_of_a_frame_is_that_of_the_outputs_of_the_network() -> None:
    raw = np.array([0.7, -0.4, 1.0, -2.0, 3.0, -4.0, -4.0, 0.0, 0.5, 9.0, 0.3, -1.5], np.float32)
    statistics = fitted(0.5, 0.1)
    layers = (*statistics.layers[:-1], (statistics.layers[-1][0], jnp.asarray(raw)))
    statistics = replace(statistics, layers=layers)
    found = jax.jit(statistical_camera.frame_distribution)(
        statistics, jnp.zeros(FEATURE_COUNT, jnp.float32), jnp.asarray(True)
    )
    weights = np.exp([0.0, *raw[:2]])
    probabilities = np.exp([found.log_none, found.log_true, found.log_false])
    np.testing.assert_allclose(probabilities, weights / weights.sum(), rtol=1e-5)
    np.testing.assert_allclose(found.bias, 0.1 * raw[2:6], rtol=1e-6)
    # A sigmoid from bound to bound, of slope one half way.
    np.testing.assert_allclose(found.log_sigma, 5.5 / (1.0 + np.exp(-(raw[6:10] - 0.25) * 4.0 / 5.5)) - 5.5, atol=1e-5)
    np.testing.assert_allclose(found.score, [2.3, 4.0 / (1.0 + np.exp(1.5)) - 2.0], rtol=1e-5)


def test_each_random_number_decides_one_thing() -> None:
    """Kind of the box by the first uniform number, width by the second, the false box by the others."""
    statistics = fitted(true=0.6, false=0.2, bias=0.01, wide=0.3)
    normals = np.array([0.5, -1.0, 0.25, 2.0, -0.7])
    lasting = np.array([-0.3, 0.2, 1.1, -0.6])
    # No box, narrow, wide, false one.
    uniforms = np.full((4, UNIFORMS_PER_FRAME), 0.5)
    uniforms[:, 0], uniforms[:, 1] = [0.7, 0.3, 0.3, 0.9], [0.31, 0.31, 0.29, 0.29]
    uniforms[3, 2:6] = [0.25, 0.75, 0.6, 0.1]
    yes = jnp.asarray(True)

    def one(uniforms: jax.Array) -> CameraFrame:
        return statistical_camera.measure(
            statistics,
            scene(),
            jnp.asarray(OUTLINE),
            yes,
            SIZE,
            yes,
            yes,
            *map(jnp.asarray, (lasting, normals)),
            uniforms,
        )

    found = jax.jit(jax.vmap(one))(uniforms)
    np.testing.assert_array_equal(found.box.present, [False, True, True, True])
    np.testing.assert_array_equal(found.outlier, [False, False, False, True])
    errors = MIXING @ (np.sqrt(0.7) * lasting + np.sqrt(0.3) * normals[:4])
    narrow = OUTLINE + 0.01 * MEAN_SIDE + sigma() * errors
    wide = OUTLINE + 0.01 * MEAN_SIDE + 3.0 * sigma() * errors
    np.testing.assert_allclose(found.box.edges[1:3], [narrow, wide], rtol=1e-4)
    pair = np.sqrt(-2.0 * np.log(0.6)) * np.array([np.cos(0.2 * np.pi), np.sin(0.2 * np.pi)])
    half = 0.5 * 10.0 * np.exp(0.5 * pair)
    center = np.array([32.0, 96.0])
    np.testing.assert_allclose(found.box.edges[3], [*(center - half), *(center + half)], rtol=1e-5)
    true_score, false_score = (1.0 / (1.0 + np.exp(-logit)) for logit in (2.0 - 0.7, 0.5 - 0.1 * 0.7))
    np.testing.assert_allclose(found.score, [0.0, true_score, true_score, false_score], rtol=1e-5)
