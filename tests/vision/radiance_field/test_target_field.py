"""Rays through the field of a sphere: depth, normals, density and gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.radiance_field.initial_grid import initialize_grid
from rpojax.vision.radiance_field.nerf_field import initialize_nerf
from rpojax.vision.radiance_field.target_field import RadianceField, density, render_rays

RADIUS = 0.5


@pytest.fixture(scope="module")
def sphere() -> RadianceField:
    """Initial field of a sphere of 1 m diameter."""
    points = np.random.default_rng(0).normal(size=(60_000, 3))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return initialize_grid(RADIUS * normals, normals, jax.random.key(0), 8000)


def rays_towards_sphere(offset: np.ndarray) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Rays along +z with offsets (n, 2) from the centre, a Sun behind the camera, and fill light from the side."""
    count = len(offset)
    origins = np.concatenate([offset, np.full((count, 1), -3.0)], axis=1)
    directions = np.tile([0.0, 0.0, 1.0], (count, 1))
    suns = np.tile([0.0, 0.6, -0.8], (count, 1))
    fills = np.tile([1.0, 0.0, 0.0], (count, 1))
    return tuple(jnp.asarray(values, jnp.float32) for values in (origins, directions, suns, fills))


def test_rays_hit_sphere_with_its_normal(sphere: RadianceField) -> None:
    offset = np.random.default_rng(1).uniform(-0.28, 0.28, (200, 2))
    found = render_rays(sphere, *rays_towards_sphere(offset))
    height = np.sqrt(RADIUS**2 - np.sum(offset**2, axis=1))
    # The spacing of the grid is 2 to 3 cm, and the initial field is as much thicker than the surface.
    np.testing.assert_allclose(found.alpha, 1.0, atol=0.02)
    np.testing.assert_allclose(found.depth / found.alpha, 3.0 - height, atol=0.05)
    expected = np.concatenate([offset, -height[:, None]], axis=1) / RADIUS
    assert np.sum(np.asarray(found.normal) * expected, axis=1).min() > 0.99


def test_rays_beside_sphere_are_empty(sphere: RadianceField) -> None:
    angle = np.linspace(0.0, 6.0, 20)
    beside = (RADIUS + 0.15) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = render_rays(sphere, *rays_towards_sphere(beside))
    np.testing.assert_allclose(found.alpha, 0.0, atol=1e-3)
    np.testing.assert_allclose(found.sunlit, 0.0, atol=1e-3)
    np.testing.assert_allclose(found.filled, 0.0, atol=1e-3)


def test_density_is_high_on_surface_and_zero_elsewhere(sphere: RadianceField) -> None:
    points = jnp.array([[RADIUS, 0.0, 0.0], [0.0, -RADIUS, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.7]], jnp.float32)
    found = np.asarray(density(sphere, points))
    assert found[:2].min() > 50.0
    assert found[2:].max() < 0.1


@pytest.mark.parametrize("kind", ["grid", "point"])
def test_colour_and_alpha_have_finite_gradients_in_pose_and_sun(sphere: RadianceField, kind: str) -> None:
    field = sphere if kind == "grid" else initialize_nerf(-np.ones(3) * 0.5, np.ones(3) * 0.5, jax.random.key(0))
    offset = np.stack([np.linspace(0.3, 0.7, 21), np.zeros(21)], axis=1)
    rays = rays_towards_sphere(offset)

    def brightness(*rays: jax.Array) -> jax.Array:
        found = render_rays(field, *rays)
        return jnp.sum(found.sunlit) + jnp.sum(found.filled) + jnp.sum(found.alpha)

    gradients = jax.grad(brightness, argnums=(0, 1, 2, 3))(*rays)
    assert all(np.isfinite(np.asarray(gradient)).all() for gradient in gradients)
    assert all(np.abs(np.asarray(gradient)).max() > 1e-4 for gradient in gradients)
    if kind == "grid":
        # Alpha falls with the distance from the centre.
        edge = jax.grad(lambda o: jnp.sum(render_rays(field, o, *rays[1:]).alpha))(rays[0])
        assert float(jnp.sum(edge[:, 0])) < -1.0


def test_batch_equals_single_rays(sphere: RadianceField) -> None:
    rays = rays_towards_sphere(np.random.default_rng(2).uniform(-0.5, 0.5, (6, 2)))
    together = render_rays(sphere, *rays)
    for index in range(6):
        alone = render_rays(sphere, *(values[index : index + 1] for values in rays))
        np.testing.assert_allclose(alone.sunlit[0], together.sunlit[index], atol=1e-5)
        np.testing.assert_allclose(alone.filled[0], together.filled[index], atol=1e-5)
        np.testing.assert_allclose(alone.alpha[0], together.alpha[index], atol=1e-5)
