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


def spot(sigma: tuple[float, float], middle: tuple[float, float], size: int = 96) -> np.ndarray:
    """Gaussian spot (size, size, 3) of unit sum, with sigma and middle across and down [px]."""
    pixel = np.arange(size)
    rows = [
        np.exp(-0.5 * ((pixel - m) / s) ** 2) / (s * np.sqrt(2.0 * np.pi)) for s, m in zip(sigma, middle, strict=True)
    ]
    return np.repeat((rows[1][:, None] * rows[0][None, :])[..., None], 3, axis=2).astype(np.float32)


def moments(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle (2,) and covariance (2, 2) across and down of the light of an image [px]."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    light = image[..., 0].astype(np.float64)
    places = np.stack([x, y])
    middle = np.sum(places * light, axis=(1, 2)) / light.sum()
    away = places - middle[:, None, None]
    return middle, np.einsum("ihw,jhw,hw->ij", away, away, light) / light.sum()


def optics(**changes: float) -> Exposure:
    """Optics with a blur of 0.8 px."""
    numbers = {"gain": 1.0, "full_well": 1e8, "read_noise": 0.0, "blur": 0.8} | changes
    return Exposure(**{name: jnp.float32(value) for name, value in numbers.items()})


@pytest.mark.parametrize("smear", [(0.0, 0.0), (3.0, -1.5), (0.4, 5.0)])
def test_smear_is_the_convolution_with_a_line(smear: tuple[float, float]) -> None:
    image = spot((2.0, 2.5), (47.3, 48.6))
    found = jax.jit(exposure.through_optics)(image, optics(), 1.0, jnp.asarray(smear, jnp.float32))
    middle, covariance = moments(np.asarray(found))
    # Variances of the spot, the blur, and an even line.
    expected = np.diag([2.0**2, 2.5**2]) + 0.8**2 * np.eye(2) + np.outer(smear, smear) / 12.0
    np.testing.assert_allclose(middle, [47.3, 48.6], atol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), np.sqrt(np.diag(expected)), atol=1e-4)
    np.testing.assert_allclose(covariance[0, 1], expected[0, 1], atol=5e-4)


def test_smeared_image_is_the_mean_of_moved_ones() -> None:
    smear, sigma = np.array([4.0, -2.0]), np.hypot(2.0, 0.8)
    found = jax.jit(exposure.through_optics)(
        spot((2.0, 2.0), (48.0, 47.0)), optics(), 1.0, jnp.asarray(smear, jnp.float32)
    )
    ways = (np.arange(400) + 0.5) / 400 - 0.5
    moved = [spot((sigma, sigma), (48.0 + s * smear[0], 47.0 + s * smear[1])) for s in ways]
    np.testing.assert_allclose(found, np.mean(moved, axis=0), atol=2e-6)


@pytest.mark.parametrize("smear", [(0.0, 0.0), (12.0, 0.0), (24.0, -6.0)])
def test_an_even_picture_stays_even_up_to_its_border(smear: tuple[float, float]) -> None:
    image = np.full((64, 64, 3), 0.3, np.float32)
    settings = optics(blur=0.6, bloom=0.2, bloom_radius=6.0)
    found = jax.jit(exposure.through_optics)(image, settings, 1.0, jnp.asarray(smear, jnp.float32))
    np.testing.assert_allclose(found, 0.3, rtol=1e-5)


@pytest.mark.parametrize("length", [6.0, 12.0, 24.0])
def test_a_long_smear_of_a_point_is_an_even_line(length: float) -> None:
    image = np.zeros((96, 96, 3), np.float32)
    image[48, 48] = 1.0
    found = jax.jit(exposure.through_optics)(image, optics(blur=0.6), 1.0, jnp.asarray([length, 0.0], jnp.float32))
    line = np.asarray(found)[..., 0].sum(axis=0)
    inside = line[int(48 - 0.5 * length) + 4 : int(48 + 0.5 * length) - 3]
    np.testing.assert_allclose(inside * length, 1.0, atol=0.02)


def test_bloom_scatters_its_fraction_into_a_halo() -> None:
    image = spot((2.0, 2.0), (48.0, 48.0))
    plain = np.asarray(jax.jit(exposure.through_optics)(image, optics()))
    found = np.asarray(jax.jit(exposure.through_optics)(image, optics(bloom=0.1, bloom_radius=6.0)))
    np.testing.assert_allclose(found.sum(), image.sum(), rtol=1e-5)
    _, covariance = moments((found - 0.9 * plain) / 0.1)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), np.hypot(2.0, 6.0), rtol=1e-3)
