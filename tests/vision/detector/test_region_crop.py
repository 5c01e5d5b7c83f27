"""Crops of an image: position, filtering, padding and gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.detector.region_crop import CROP_PX, crop_boxes

SIZE = 96


def crop_one(image: jax.Array, box: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Crop around one box, and its edges."""
    crops, edges = crop_boxes(image, box[None])
    return crops[0], edges[0]


def ramp(slope_x: float, slope_y: float) -> jax.Array:
    """An image with a linear ramp of codes."""
    place = (np.arange(SIZE) + 0.5) / SIZE
    values = slope_x * place[None, :] + slope_y * place[:, None]
    return jnp.asarray(np.repeat(values[:, :, None], 3, axis=2), jnp.float32)


@pytest.mark.parametrize("box", [(30.0, 40.0, 36.0, 44.0), (20.0, 24.0, 60.0, 70.0), (26.5, 30.0, 70.25, 38.0)])
def test_crop_of_ramp_is_ramp_at_crop_position(box: tuple[float, ...]) -> None:
    found, edges = crop_one(ramp(0.6, 0.3), jnp.asarray(box, jnp.float32))
    low, high = np.asarray(edges[:2]), np.asarray(edges[2:])
    assert (low < box[:2]).all()
    assert (high > box[2:]).all()
    place = (np.arange(CROP_PX) + 0.5) / CROP_PX
    x, y = ((low[i] + place * (high[i] - low[i])) / SIZE for i in (0, 1))
    expected = 2.0 * (0.6 * x[None, :] + 0.3 * y[:, None]) - 1.0
    np.testing.assert_allclose(found[..., 0], expected, atol=3e-3)
    np.testing.assert_array_equal(found[..., 3], 1.0)


def test_coarse_crop_is_free_of_aliasing() -> None:
    image = np.zeros((SIZE, SIZE, 3), np.float32)
    image[::2] = 1.0  # stripes at the Nyquist frequency
    found, _ = crop_one(jnp.asarray(image), jnp.asarray([8.0, 8.0, 88.0, 88.0], jnp.float32))
    inside = np.asarray(found[4:-4, 4:-4, 0])
    np.testing.assert_allclose(inside, 0.0, atol=0.15)


def test_outside_of_image_is_masked() -> None:
    found, edges = crop_one(ramp(0.0, 0.0) + 0.9, jnp.asarray([80.0, 30.0, 120.0, 50.0], jnp.float32))
    low, high = float(edges[0]), float(edges[2])
    x = low + (np.arange(CROP_PX) + 0.5) / CROP_PX * (high - low)
    np.testing.assert_array_equal(np.asarray(found[CROP_PX // 2, :, 3]), (x < SIZE).astype(np.float32))
    np.testing.assert_array_equal(np.asarray(found)[:, x > SIZE, :3], 0.0)
    np.testing.assert_allclose(np.asarray(found)[8:-8, x < SIZE - 2, :3], 0.8, atol=1e-5)


def test_crop_gradient_in_box_matches_finite_differences() -> None:
    image = jax.random.uniform(jax.random.key(0), (SIZE, SIZE, 3), jnp.float32)
    box = jnp.asarray([20.3, 31.1, 44.2, 52.9], jnp.float32)
    weight = jax.random.normal(jax.random.key(1), (CROP_PX, CROP_PX, 4), jnp.float32)

    def readout(box: jax.Array) -> jax.Array:
        return jnp.sum(weight * crop_one(image, box)[0])

    gradient = jax.grad(readout)(box)
    for edge in range(4):
        step = jnp.zeros(4, jnp.float32).at[edge].set(0.01)
        difference = (readout(box + step) - readout(box - step)) / 0.02
        assert float(gradient[edge]) == pytest.approx(float(difference), rel=0.05, abs=0.3)
