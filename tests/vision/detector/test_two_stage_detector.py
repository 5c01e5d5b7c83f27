"""Boxes of both networks of the packaged detector."""

from functools import partial
from typing import Any

import cv2
import jax
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


def test_soft_box_gradient_matches_finite_differences(packaged: two_stage_detector.DetectorParams) -> None:
    image = cv2.GaussianBlur(rectangle(40, 50, 80, 76), (0, 0), 1.0)
    shift = 0.5 * (np.roll(image, -1, axis=1) - np.roll(image, 1, axis=1))
    (box, score), (gradient, _) = soft_detect_along(packaged, image, shift)
    np.testing.assert_allclose(box, [40, 50, 80, 76], atol=3.0)
    assert score > 0.5
    step = np.float32(0.02)
    ahead, back = (
        np.asarray(soft_detect_along(packaged, image + sign * step * shift, shift)[0][0])
        for sign in (np.float32(1.0), np.float32(-1.0))
    )
    np.testing.assert_allclose(gradient, (ahead - back) / (2.0 * step), atol=0.15)
    assert np.abs(gradient).max() > 0.3
