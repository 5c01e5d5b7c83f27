"""Boxes of both networks of the packaged detector."""

from functools import partial
from typing import Any

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import proposal_network, two_stage_detector
from rpojax.vision.detector.detector_file import load_detector

detect = jax.jit(two_stage_detector.detect, static_argnums=2)
propose = jax.jit(proposal_network.detect, static_argnums=2)


@jax.jit
def soft_detect_along(params: two_stage_detector.DetectorParams, image: jax.Array, shift: jax.Array) -> Any:
    """Best box and score of an image, and their derivatives along a change of the image."""
    return jax.jvp(partial(two_stage_detector.soft_detect, params), (image,), (shift,))


def rectangle(left: int, top: int, right: int, bottom: int) -> np.ndarray:
    """A bright rectangle on black with a darker stripe, in place of a spacecraft."""
    image = np.zeros((128, 128, 3), np.float32)
    image[top:bottom, left:right] = (0.7, 0.65, 0.5)
    image[top:bottom, (left + right) // 2 : (left + right) // 2 + 2] = 0.2
    return image


@pytest.fixture(scope="module")
def packaged() -> two_stage_detector.DetectorParams:
    """Parameters of the packaged detector."""
    return load_detector()[0]


def test_refinement_reduces_box_error(packaged: two_stage_detector.DetectorParams) -> None:
    rng = np.random.default_rng(4)
    proposal_errors, errors = [], []
    for _ in range(24):
        left, top = rng.integers(5, 60, 2)
        true = np.array([left, top, left + rng.integers(14, 60), top + rng.integers(14, 60)])
        image = rectangle(*true)[None]
        found = jax.device_get(detect(packaged, image, 2))
        assert found.score[0, 0] > found.score[0, 1]
        errors.append(np.abs(found.box_px[0, 0] - true))
        proposal_errors.append(np.abs(np.asarray(propose(packaged["proposal"], image, 2).box_px)[0, 0] - true))
    assert np.mean(errors) < 0.8 * np.mean(proposal_errors)
    assert np.median(errors) < 1.0


def test_detections_are_sorted_and_inside_image(packaged: two_stage_detector.DetectorParams) -> None:
    images = np.random.default_rng(2).random((3, 64, 96, 3), np.float32)
    found = jax.device_get(detect(packaged, images, 4))
    assert found.box_px.shape == (3, 4, 4)
    assert (np.diff(found.score, axis=1) <= 0.0).all()
    assert found.box_px.min() >= 0.0
    assert (found.box_px.reshape(-1, 4).max(axis=0) <= [96, 64, 96, 64]).all()


def test_soft_box_and_score_have_the_derivative_of_the_image(packaged: two_stage_detector.DetectorParams) -> None:
    double = jax.tree.map(lambda each: each.astype(np.float64), packaged)
    image = cv2.GaussianBlur(rectangle(40, 50, 80, 76), (0, 0), 1.0).astype(np.float64)
    shift = 0.5 * (np.roll(image, -1, axis=1) - np.roll(image, 1, axis=1))
    pixels, along, step = jnp.asarray(image), jnp.asarray(shift), 1e-6
    with jax.numpy_dtype_promotion("standard"):  # differences need double precision, in which no network runs
        (box, log_odds), derivatives = soft_detect_along(double, pixels, along)
        ahead, back = (soft_detect_along(double, pixels + sign * along, along)[0] for sign in (step, -step))
    np.testing.assert_allclose(box, [40, 50, 80, 76], atol=3.0)
    assert log_odds > 0.0
    for found, high, low in zip(derivatives, ahead, back, strict=True):
        central = (np.asarray(high) - np.asarray(low)) / (2.0 * step)
        # The step is below the distance to the next kink of a rectified linear unit.
        np.testing.assert_allclose(found, central, rtol=1e-4)
    # The target moves to the left by a pixel.
    np.testing.assert_allclose(derivatives[0][::2], -1.0, atol=0.5)


def test_soft_detector_of_a_low_temperature_is_the_hard_one(packaged: two_stage_detector.DetectorParams) -> None:
    soft = jax.jit(two_stage_detector.soft_detect, static_argnums=(2, 3))
    for corners in ((40, 50, 80, 76), (12, 70, 30, 101)):
        image = cv2.GaussianBlur(rectangle(*corners), (0, 0), 1.0)
        hard = detect(packaged, image[None], 2)
        box, log_odds = soft(packaged, image, 1e-3, 2)
        np.testing.assert_allclose(box, hard.box_px[0, 0], atol=2e-3)
        np.testing.assert_allclose(jax.nn.sigmoid(log_odds), hard.score[0, 0], atol=1e-4)
        assert np.abs(np.asarray(soft(packaged, image, 1.0, 2)[0]) - np.asarray(hard.box_px[0, 0])).max() > 5e-3


def test_soft_box_has_the_derivative_of_a_weight(packaged: two_stage_detector.DetectorParams) -> None:
    double = jax.tree.map(lambda each: each.astype(np.float64), packaged)
    image = cv2.GaussianBlur(rectangle(40, 50, 80, 76), (0, 0), 1.0)

    @jax.jit
    def left_edge(bias: jax.Array) -> jax.Array:
        first = {**double["proposal"], "out": {**double["proposal"]["out"], "bias": bias}}
        pixels = jnp.asarray(image, jnp.float64)
        return two_stage_detector.soft_detect({**double, "proposal": first}, pixels)[0][0]

    bias, step = double["proposal"]["out"]["bias"], jnp.asarray(1e-6 * np.eye(5)[1])
    with jax.numpy_dtype_promotion("standard"):  # differences need double precision, in which no network runs
        central = float(left_edge(bias + step) - left_edge(bias - step)) / 2e-6
        derivative = float(jax.grad(left_edge)(bias)[1])
    assert abs(central) > 0.01
    # The step is below the distance to the next kink of a rectified linear unit.
    assert derivative == pytest.approx(central, rel=1e-5)
