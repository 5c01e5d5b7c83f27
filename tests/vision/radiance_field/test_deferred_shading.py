"""Microfacet lobe: energy, reciprocity, and its peak."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.radiance_field.deferred_shading import microfacet_lobe


def radiance(view: np.ndarray, light: np.ndarray, mirror: float, roughness: float) -> np.ndarray:
    """Radiance (n,) by unit irradiance across the light of a surface with normal z; directions (n, 3)."""
    half = view + light
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    terms = (light[:, 2], view[:, 2], half[:, 2], np.sum(view * half, axis=1))
    lobe = jax.vmap(microfacet_lobe, in_axes=(None, None, 0, 0, 0, 0))
    return np.asarray(lobe(jnp.full(3, mirror), jnp.asarray(roughness), *map(jnp.asarray, terms)))[:, 0]


@pytest.mark.parametrize("roughness", [0.25, 0.4, 0.7])
def test_mirror_throws_back_no_more_than_it_gets(roughness: float) -> None:
    rng = np.random.default_rng(0)
    height, azimuth = rng.random(400_000), rng.uniform(0.0, 2.0 * np.pi, 400_000)
    level = np.sqrt(1.0 - height**2)
    view = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=1)
    light = np.broadcast_to([np.sin(0.5), 0.0, np.cos(0.5)], view.shape)
    # Even directions of the hemisphere: the integral over them is 2 pi times the mean.
    share = 2.0 * np.pi * np.mean(radiance(view, light, 1.0, roughness) * height) / np.cos(0.5)
    # Single scattering between facets loses more the rougher they are.
    assert {0.25: 0.98, 0.4: 0.95, 0.7: 0.65}[roughness] < share < 1.01


def test_light_and_view_may_be_exchanged() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 50, 3))
    a[:, 2], b[:, 2] = np.abs(a[:, 2]) + 0.1, np.abs(b[:, 2]) + 0.1
    a, b = a / np.linalg.norm(a, axis=1, keepdims=True), b / np.linalg.norm(b, axis=1, keepdims=True)
    np.testing.assert_allclose(
        radiance(a, b, 0.3, 0.5) / b[:, 2], radiance(b, a, 0.3, 0.5) / a[:, 2], rtol=1e-5, atol=1e-9
    )


def test_peak_at_normal_incidence_is_that_of_the_formula() -> None:
    normal = np.array([[0.0, 0.0, 1.0]])
    # Density 1 / (pi w^2) over 4, with a width w of the square of the roughness.
    expected = 0.04 / (4.0 * np.pi * 0.3**4)
    assert radiance(normal, normal, 0.04, 0.3)[0] == pytest.approx(expected, rel=1e-5)
