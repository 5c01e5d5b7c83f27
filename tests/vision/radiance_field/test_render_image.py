"""Images of the packaged target: geometry, eclipse, batching, and pose gradients."""

from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from experiment_modules import load_experiment

from rpojax.vision.pinhole import pinhole_intrinsics, project
from rpojax.vision.radiance_field import render_image
from rpojax.vision.radiance_field.field_file import load_field
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.radiance_field.target_field import RadianceField

TIPS = np.array([[x, y, 0.0] for x in (-0.22, 0.22) for y in (-0.8, 0.8)])

render_target = jax.jit(render_image.render_target, static_argnums=(2, 3, 4))
square_intrinsics = jax.jit(pinhole_intrinsics, static_argnums=(1, 2))


@pytest.fixture(scope="module")
def field() -> RadianceField:
    """Field of the packaged target."""
    return load_field()[0]


@pytest.fixture(scope="module")
def measure() -> ModuleType:
    """Script of the experiment on radiance fields."""
    return load_experiment("radiance_field/measure.py")


def render(
    field: RadianceField,
    position: np.ndarray,
    rotation: np.ndarray,
    region: int = 64,
    sunlight: float = 1.0,
    fill: float = 0.0,
    size: int = 64,
) -> render_image.RenderedTarget:
    """Image of the field in a square camera of 10 deg, with all rays of a region."""
    intrinsics = square_intrinsics(np.radians(10.0), size, size)
    pose = [np.asarray(value, np.float32) for value in (position, rotation)]
    rays = RaySampling(region, region * region)
    return jax.device_get(render_target(field, intrinsics, size, size, rays, *pose, light(sunlight, fill)))


def light(sunlight: float = 1.0, fill: float = 0.0) -> render_image.Light:
    """Light of a Sun above the target, and fill light from below."""
    sun_T, fill_T = jnp.array([0.0, 0.6, 0.8], jnp.float32), jnp.array([0.0, 0.0, -1.0], jnp.float32)
    return render_image.Light(sun_T=sun_T, sunlight=jnp.float32(sunlight), fill_T=fill_T, fill=jnp.float32(fill))


DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
"""Axes of a camera above the target with its boresight along -z."""


@pytest.mark.parametrize("offset", [0.0, 0.7])
def test_silhouette_matches_pinhole_projection_of_panels(field: RadianceField, offset: float) -> None:
    position = np.array([0.1, offset, 20.0])
    alpha = np.asarray(render(field, position, DOWN, size=128).alpha)
    tips = np.asarray(jax.jit(project)(square_intrinsics(np.radians(10.0), 128, 128), (TIPS - position) @ DOWN.T))
    rows = np.nonzero(alpha.max(axis=1) > 0.5)[0]
    assert abs(rows[0] - tips[1].min()) < 1.5
    assert abs(rows[-1] + 1 - tips[1].max()) < 1.5


def test_total_radiance_is_independent_of_resolution(field: RadianceField) -> None:
    position = np.array([0.0, 0.0, 60.0])
    fine = render(field, position, DOWN, size=64)
    coarse = render(field, position, DOWN, size=16)
    np.testing.assert_allclose(np.sum(fine.alpha) / 16.0, np.sum(coarse.alpha), rtol=2e-3)
    np.testing.assert_allclose(np.sum(fine.color) / 16.0, np.sum(coarse.color), rtol=2e-3)


def test_target_in_eclipse_is_dark_and_opaque(field: RadianceField) -> None:
    found = render(field, np.array([0.0, 0.0, 20.0]), DOWN, sunlight=0.0)
    np.testing.assert_array_equal(found.color, 0.0)
    assert found.alpha.max() > 0.95
    image = np.asarray(jax.jit(render_image.alpha_composite)(found, np.ones_like(found.color)))
    assert image.min() < 0.05


def test_fill_light_stays_in_eclipse_and_comes_from_its_side(field: RadianceField) -> None:
    above, below = np.array([0.0, 0.0, 20.0]), np.array([0.0, 0.0, -20.0])
    up = DOWN * np.array([1.0, -1.0, -1.0])[:, None]
    dark, lit = render(field, above, DOWN, sunlight=0.0, fill=0.2), render(field, below, up, sunlight=0.0, fill=0.2)
    assert np.sum(lit.color) > 2.0 * np.sum(dark.color)
    both = render(field, below, up, sunlight=1.0, fill=0.2)
    sun_alone = render(field, below, up, sunlight=1.0)
    np.testing.assert_allclose(both.color, sun_alone.color + lit.color, atol=1e-5)


def test_target_behind_camera_is_not_rendered(field: RadianceField) -> None:
    found = render(field, np.array([0.0, 0.0, -20.0]), DOWN)
    np.testing.assert_array_equal(found.alpha, 0.0)


def test_images_batch_under_vmap(field: RadianceField) -> None:
    positions = np.array([[0.0, 0.0, 20.0], [0.2, 0.0, 30.0]], np.float32)
    intrinsics = square_intrinsics(np.radians(10.0), 32, 32)
    rotation = jnp.asarray(DOWN, jnp.float32)

    def color(position: jax.Array) -> jax.Array:
        rays = RaySampling(32, 32 * 32)
        return render_image.render_target(field, intrinsics, 32, 32, rays, position, rotation, light()).color

    together = np.asarray(jax.jit(jax.vmap(color))(positions))
    alone = jax.jit(color)
    for index in range(2):
        np.testing.assert_allclose(together[index], alone(positions[index]), atol=1e-5)


def test_silhouette_gradient_recovers_pose(measure: ModuleType, field: RadianceField) -> None:
    # With fewer rays than in the experiment.
    found = measure.recover_pose(field, seed=0, rays=RaySampling(56, 1216))
    assert found.turn_deg[0] == pytest.approx(3.0, abs=1e-3)
    assert found.range_percent[0] == pytest.approx(3.0, abs=1e-3)
    # A tenth of the initial errors of 3 deg and 3 %.
    assert found.turn_deg[1] < 0.3
    assert found.range_percent[1] < 0.3
