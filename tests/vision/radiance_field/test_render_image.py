"""From field to frame: the square of rays, averaging, eclipse, the camera's errors, and poses mended by gradients."""

from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from experiment_modules import load_experiment

from rpojax.vision.imaging.exposure import Exposure, expose
from rpojax.vision.pinhole import pinhole_intrinsics, project
from rpojax.vision.radiance_field import render_image
from rpojax.vision.radiance_field.field_file import load_field
from rpojax.vision.radiance_field.image_region import project_region
from rpojax.vision.radiance_field.ray_budget import REGION_SIDES, RaySampling, region_side
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere

TIPS = np.array([[x, y, 0.0] for x in (-0.22, 0.22) for y in (-0.8, 0.8)])


@pytest.fixture(scope="module")
def field() -> RadianceField:
    """The packaged target's."""
    return load_field()[0]


@pytest.fixture(scope="module")
def measure() -> ModuleType:
    """The script of the experiment."""
    return load_experiment("radiance_field/measure.py")


def frame_of(
    field: RadianceField,
    position: np.ndarray,
    rotation: np.ndarray,
    region: int = 64,
    light: float = 1.0,
    size: int = 64,
) -> render_image.RenderedTarget:
    optics = pinhole_intrinsics(jnp.asarray(np.radians(10.0)), size, size)
    parts = [jnp.asarray(value, jnp.float32) for value in (position, rotation, np.array([0.0, 0.6, 0.8]), light)]
    return render_image.render_target(field, optics, size, size, RaySampling(region, region * region), *parts)


DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
"""Camera above the target that looks along -z."""


@pytest.mark.parametrize("aside", [0.0, 0.7])
def test_the_silhouette_is_where_the_pinhole_puts_the_panels(field: RadianceField, aside: float) -> None:
    position = np.array([0.1, aside, 20.0])
    alpha = np.asarray(frame_of(field, position, DOWN, size=128).alpha)
    optics = pinhole_intrinsics(jnp.asarray(np.radians(10.0)), 128, 128)
    tips = np.asarray(project(optics, jnp.asarray((TIPS - position) @ DOWN.T)))
    rows = np.nonzero(alpha.max(axis=1) > 0.5)[0]
    assert abs(rows[0] - tips[1].min()) < 1.5
    assert abs(rows[-1] + 1 - tips[1].max()) < 1.5


def test_averaging_keeps_the_light_whatever_the_pixels_are(field: RadianceField) -> None:
    position = np.array([0.0, 0.0, 60.0])
    fine = frame_of(field, position, DOWN, size=64)
    coarse = frame_of(field, position, DOWN, size=16)
    np.testing.assert_allclose(np.sum(fine.alpha) / 16.0, np.sum(coarse.alpha), rtol=2e-3)
    np.testing.assert_allclose(np.sum(fine.color) / 16.0, np.sum(coarse.color), rtol=2e-3)


def test_a_target_in_eclipse_is_dark_and_still_hides_what_is_behind(field: RadianceField) -> None:
    found = frame_of(field, np.array([0.0, 0.0, 20.0]), DOWN, light=0.0)
    np.testing.assert_array_equal(found.color, 0.0)
    assert float(jnp.max(found.alpha)) > 0.95
    picture = render_image.alpha_composite(found, jnp.ones_like(found.color))
    assert float(jnp.min(picture)) < 0.05


def test_a_target_behind_the_camera_is_not_seen(field: RadianceField) -> None:
    found = frame_of(field, np.array([0.0, 0.0, -20.0]), DOWN)
    np.testing.assert_array_equal(found.alpha, 0.0)


def test_frames_batch_under_vmap(field: RadianceField) -> None:
    positions = jnp.asarray([[0.0, 0.0, 20.0], [0.2, 0.0, 30.0]], jnp.float32)
    optics = pinhole_intrinsics(jnp.asarray(np.radians(10.0)), 32, 32)
    rotation, sun = jnp.asarray(DOWN, jnp.float32), jnp.asarray([0.0, 0.6, 0.8], jnp.float32)

    def one(position: jax.Array) -> jax.Array:
        lit = jnp.ones((), jnp.float32)
        return render_image.render_target(
            field, optics, 32, 32, RaySampling(32, 32 * 32), position, rotation, sun, lit
        ).color

    together = jax.vmap(one)(positions)
    for index in range(2):
        np.testing.assert_allclose(together[index], one(positions[index]), atol=1e-5)


def test_the_region_is_chosen_by_the_least_range() -> None:
    assert region_side(732.0, 0.9, 30.0, 1.5) == 96
    assert region_side(732.0, 0.9, 100.0, 1.5) == 32
    assert region_side(732.0, 0.9, 0.5, 1.5) == REGION_SIDES[-1]


def test_the_detector_has_the_noise_and_the_saturation_that_it_says() -> None:
    settings = Exposure(
        gain=jnp.float32(2.0), full_well=jnp.float32(1e4), read_noise=jnp.float32(20.0), blur=jnp.float32(0.0)
    )
    image = jnp.full((200, 200, 3), 0.1, jnp.float32)
    noise = jax.random.normal(jax.random.key(0), (200, 200, 3), jnp.float32)
    seen = np.asarray(expose(image, settings, noise))
    inside = seen[4:-4, 4:-4]
    assert inside.mean() == pytest.approx(0.2, rel=1e-3)
    assert inside.std() == pytest.approx(np.sqrt(0.2 * 1e4 + 20.0**2) / 1e4, rel=0.02)
    assert np.asarray(expose(image * 10.0, settings, noise)).max() == 1.0


def test_without_read_noise_black_has_a_slope_that_is_finite() -> None:
    zero = jnp.float32(0.0)
    settings = Exposure(gain=jnp.float32(1.0), full_well=jnp.float32(1e4), read_noise=zero, blur=zero)
    image = jnp.zeros((8, 8, 3), jnp.float32).at[3, 3].set(1.0)
    noise = jnp.ones_like(image)
    slope = jax.grad(lambda light: jnp.sum(expose(light * image, settings, noise)))(jnp.float32(0.1))
    assert 1.0 < float(slope) / 3.0 < 1.1


def test_an_even_scene_stays_even_up_to_the_edge_of_the_frame() -> None:
    settings = Exposure(
        gain=jnp.float32(1.0), full_well=jnp.float32(1e8), read_noise=jnp.float32(0.0), blur=jnp.float32(1.0)
    )
    image = jnp.full((12, 12, 3), 0.3, jnp.float32)
    np.testing.assert_allclose(expose(image, settings, jnp.zeros_like(image)), 0.3, rtol=1e-5)


@pytest.mark.parametrize("aside_deg", [0.0, 10.0, 25.0, 35.0])
def test_the_square_of_rays_holds_the_whole_ball_and_little_more(field: RadianceField, aside_deg: float) -> None:
    middle, radius = (np.asarray(value, np.float64) for value in bounding_sphere(field))
    optics = pinhole_intrinsics(jnp.asarray(np.radians(60.0)), 256, 256)
    angle, half = np.radians(aside_deg), np.radians(20.0)
    direction_K = np.array([np.sin(angle), 0.0, np.cos(angle)])
    r_KT_T = middle - radius / np.sin(half) * direction_K
    corner, side, visible = project_region(field, optics, *(jnp.asarray(v, jnp.float32) for v in (r_KT_T, np.eye(3))))
    low = (np.asarray(corner) - np.asarray(optics.center_px)) / float(optics.focal_px)
    high = low + float(side) / float(optics.focal_px)
    assert bool(visible)
    # The rim of the ball is a cone of 20 deg about the line to its middle.
    assert low[0] < np.tan(angle - half)
    assert np.tan(angle + half) < high[0]
    assert high[0] - low[0] < 1.1 * (np.tan(angle + half) - np.tan(angle - half))


def test_blur_keeps_the_light_and_spreads_it() -> None:
    point = jnp.zeros((21, 21, 3), jnp.float32).at[10, 10].set(0.5)
    settings = Exposure(
        gain=jnp.float32(1.0), full_well=jnp.float32(1e8), read_noise=jnp.float32(0.0), blur=jnp.float32(1.0)
    )
    nothing = jnp.zeros((21, 21, 3), jnp.float32)
    seen = np.asarray(expose(point, settings, nothing))[..., 0]
    place = np.arange(21) - 10.0
    assert seen.sum() == pytest.approx(0.5, rel=1e-3)
    assert np.sqrt((seen.sum(axis=0) * place**2).sum() / seen.sum()) == pytest.approx(1.0, abs=0.03)


def test_the_gradient_of_a_silhouette_mends_a_wrong_pose(measure: ModuleType, field: RadianceField) -> None:
    # Fewer rays than the experiment follows.
    found = measure.recover_pose(field, seed=0, rays=RaySampling(56, 1216))
    assert found.turn_deg[0] == pytest.approx(3.0, abs=1e-3)
    assert found.range_percent[0] == pytest.approx(3.0, abs=1e-3)
    # From 3 deg and 3 %, to a tenth of both.
    assert found.turn_deg[1] < 0.3
    assert found.range_percent[1] < 0.3
