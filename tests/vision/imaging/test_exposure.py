"""Exposure: noise, saturation and blur of the image sensor."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.imaging import exposure
from rpojax.vision.imaging.exposure import Exposure

expose = jax.jit(exposure.expose)


def test_noise_and_saturation_match_parameters() -> None:
    settings = Exposure(
        gain=jnp.float32(2.0), full_well=jnp.float32(1e4), read_noise=jnp.float32(20.0), blur=jnp.float32(0.0)
    )
    image = np.full((200, 200, 3), 0.1, np.float32)
    noise = np.random.default_rng(0).standard_normal((200, 200, 3), np.float32)
    exposed = np.asarray(expose(image, settings, noise))
    inside = exposed[4:-4, 4:-4]
    assert inside.mean() == pytest.approx(0.2, rel=1e-3)
    assert inside.std() == pytest.approx(np.sqrt(0.2 * 1e4 + 20.0**2) / 1e4, rel=0.02)
    assert np.asarray(expose(10.0 * image, settings, noise)).max() == 1.0


def test_gradient_of_black_pixel_without_read_noise_is_finite() -> None:
    zero = jnp.float32(0.0)
    settings = Exposure(gain=jnp.float32(1.0), full_well=jnp.float32(1e4), read_noise=zero, blur=zero)
    image = np.zeros((8, 8, 3), np.float32)
    image[3, 3] = 1.0
    noise = np.ones_like(image)
    gradient = jax.jit(jax.grad(lambda light: jnp.sum(expose(light * image, settings, noise))))(jnp.float32(0.1))
    assert 1.0 < float(gradient) / 3.0 < 1.1


def test_blur_of_uniform_image_is_uniform_up_to_edges() -> None:
    settings = Exposure(
        gain=jnp.float32(1.0), full_well=jnp.float32(1e8), read_noise=jnp.float32(0.0), blur=jnp.float32(1.0)
    )
    image = np.full((12, 12, 3), 0.3, np.float32)
    np.testing.assert_allclose(expose(image, settings, np.zeros_like(image)), 0.3, rtol=1e-5)


def test_blur_preserves_sum_and_has_requested_sigma() -> None:
    point = np.zeros((21, 21, 3), np.float32)
    point[10, 10] = 0.5
    settings = Exposure(
        gain=jnp.float32(1.0), full_well=jnp.float32(1e8), read_noise=jnp.float32(0.0), blur=jnp.float32(1.0)
    )
    no_noise = np.zeros((21, 21, 3), np.float32)
    exposed = np.asarray(expose(point, settings, no_noise))[..., 0]
    place = np.arange(21) - 10.0
    assert exposed.sum() == pytest.approx(0.5, rel=1e-3)
    assert np.sqrt((exposed.sum(axis=0) * place**2).sum() / exposed.sum()) == pytest.approx(1.0, abs=0.03)
