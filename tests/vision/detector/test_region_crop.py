"""Crops of an image: position, filtering, padding and gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector.region_crop import CHANNELS, CROP_PX, crop_boxes, crop_maps

SIZE = 96


@jax.jit
def crop_one(image: jax.Array, box: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Crop around one box, and its edges."""
    crops, edges = crop_boxes(image, box[None])
    return crops[0], edges[0]


def ramp(slope_x: float, slope_y: float) -> np.ndarray:
    """An image with a linear ramp of codes."""
    place = (np.arange(SIZE) + 0.5) / SIZE
    values = slope_x * place[None, :] + slope_y * place[:, None]
    return np.repeat(values[:, :, None], 3, axis=2).astype(np.float32)


@pytest.mark.parametrize("box", [(30.0, 40.0, 36.0, 44.0), (24.0, 28.0, 56.0, 66.0), (26.5, 30.0, 70.25, 38.0)])
def test_crop_of_ramp_is_ramp_at_crop_position(box: tuple[float, ...]) -> None:
    found, edges = crop_one(ramp(0.6, 0.3), np.asarray(box, np.float32))
    low, high = np.split(np.asarray(edges), 2)
    assert (low < box[:2]).all()
    assert (high > box[2:]).all()
    place = (np.arange(CROP_PX) + 0.5) / CROP_PX
    x, y = ((low[i] + place * (high[i] - low[i])) / SIZE for i in (0, 1))
    expected = 2.0 * (0.6 * x[None, :] + 0.3 * y[:, None]) - 1.0
    np.testing.assert_allclose(np.asarray(found)[..., 0], expected, atol=3e-3)
    np.testing.assert_array_equal(np.asarray(found)[..., 3], 1.0)


def test_last_channel_is_one_in_the_box() -> None:
    box = np.array([20.0, 24.0, 60.0, 70.0], np.float32)
    found, edges = map(np.asarray, crop_one(ramp(0.6, 0.3), box))
    sides, middle = edges[2:] - edges[:2], CROP_PX // 2
    reach = 0.5 * CROP_PX * np.array([40.0, 46.0]) / sides
    for profile, half in ((found[middle, :, 4], reach[0]), (found[:, middle, 4], reach[1])):
        # The soft edge makes the sum that of the box.
        np.testing.assert_allclose(np.sum(profile), 2.0 * half, atol=0.3)
        assert float(profile[0]) == float(profile[-1]) == 0.0
        assert float(profile[middle]) == 1.0


def test_maps_are_taken_at_the_place_of_the_crop() -> None:
    stride, cells = 4, 12
    place = (np.arange(SIZE // stride) + 0.5) * stride
    maps = np.stack(np.meshgrid(place, place), axis=-1).astype(np.float32)
    edges = np.array([[20.0, 24.0, 68.0, 72.0]], np.float32)
    taken = np.asarray(jax.jit(crop_maps, static_argnums=(2, 3))(maps, edges, stride, cells))[0]
    expected = 20.0 + (np.arange(cells) + 0.5) * 4.0
    np.testing.assert_allclose(taken[5, :, 0], expected, atol=1e-3)
    np.testing.assert_allclose(taken[:, 5, 1], expected + 4.0, atol=1e-3)


def test_coarse_crop_is_free_of_aliasing() -> None:
    image = np.zeros((SIZE, SIZE, 3), np.float32)
    image[::2] = 1.0  # stripes at the Nyquist frequency
    found, _ = crop_one(image, np.array([8.0, 8.0, 88.0, 88.0], np.float32))
    inside = np.asarray(found)[4:-4, 4:-4, 0]
    np.testing.assert_allclose(inside, 0.0, atol=0.15)


def test_outside_of_image_is_masked() -> None:
    box = np.array([80.0, 30.0, 120.0, 50.0], np.float32)
    found, edges = map(np.asarray, crop_one(ramp(0.0, 0.0) + np.float32(0.9), box))
    low, high = float(edges[0]), float(edges[2])
    x = low + (np.arange(CROP_PX) + 0.5) / CROP_PX * (high - low)
    np.testing.assert_array_equal(found[CROP_PX // 2, :, 3], (x < SIZE).astype(np.float32))
    np.testing.assert_array_equal(found[:, x > SIZE, :3], 0.0)
    np.testing.assert_allclose(found[8:-8, x < SIZE - 2, :3], 0.8, atol=1e-5)


def test_crop_gradient_in_box_matches_finite_differences() -> None:
    image = jax.random.uniform(jax.random.key(0), (SIZE, SIZE, 3), jnp.float32)
    box = np.array([30.3, 29.1, 66.2, 66.9], np.float32)
    weight = jax.random.normal(jax.random.key(1), (CROP_PX, CROP_PX, CHANNELS), jnp.float32)

    @jax.jit
    @jax.value_and_grad
    def readout(box: jax.Array) -> jax.Array:
        return jnp.sum(weight * crop_one(image, box)[0])

    gradient = np.asarray(readout(box)[1])
    for edge, step in enumerate(0.01 * np.eye(4, dtype=np.float32)):
        difference = (float(readout(box + step)[0]) - float(readout(box - step)[0])) / 0.02
        assert gradient[edge] == pytest.approx(difference, rel=0.05, abs=0.3)
