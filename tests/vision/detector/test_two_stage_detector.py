"""Boxes of both networks of the packaged detector."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector import proposal_network, two_stage_detector
from rpojax.vision.detector.detector_file import load_detector
from rpojax.vision.detector.two_stage_detector import detect, soft_detect


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
    find, propose = (jax.jit(function, static_argnums=2) for function in (detect, proposal_network.detect))
    proposal_errors, errors = [], []
    for _ in range(24):
        left, top = rng.integers(5, 60, 2)
        true = np.array([left, top, left + rng.integers(14, 60), top + rng.integers(14, 60)])
        image = jnp.asarray(rectangle(*true))[None]
        found = find(packaged, image, 2)
        assert found.score[0, 0] > found.score[0, 1]
        errors.append(np.abs(np.asarray(found.box_px[0, 0]) - true))
        proposal_errors.append(np.abs(np.asarray(propose(packaged["proposal"], image, 2).box_px[0, 0]) - true))
    assert np.mean(errors) < 0.8 * np.mean(proposal_errors)
    assert np.median(errors) < 1.0


def test_detections_are_sorted_and_inside_image(packaged: two_stage_detector.DetectorParams) -> None:
    images = jax.random.uniform(jax.random.key(2), (3, 64, 96, 3), jnp.float32)
    found = jax.jit(detect, static_argnums=2)(packaged, images, 4)
    assert found.box_px.shape == (3, 4, 4)
    assert (np.diff(found.score, axis=1) <= 0.0).all()
    assert found.box_px.min() >= 0.0
    assert (np.asarray(found.box_px).reshape(-1, 4).max(axis=0) <= [96, 64, 96, 64]).all()


def test_soft_box_gradient_matches_finite_differences(packaged: two_stage_detector.DetectorParams) -> None:
    image = jnp.asarray(cv2.GaussianBlur(rectangle(40, 50, 80, 76), (0, 0), 1.0))
    box, score = soft_detect(packaged, image)
    np.testing.assert_allclose(box, [40, 50, 80, 76], atol=3.0)
    assert score > 0.5
    shift = 0.5 * (jnp.roll(image, -1, axis=1) - jnp.roll(image, 1, axis=1))
    find = jax.jit(lambda i: soft_detect(packaged, i)[0])
    gradient = jax.jvp(find, (image,), (shift,))[1]
    step = jnp.float32(0.02)
    difference = (find(image + step * shift) - find(image - step * shift)) / (2.0 * step)
    np.testing.assert_allclose(gradient, difference, atol=0.15)
    assert float(jnp.max(jnp.abs(gradient))) > 0.3
