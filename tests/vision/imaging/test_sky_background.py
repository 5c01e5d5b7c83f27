"""Positions of stars and Earth for a camera's position and attitude."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.vision.imaging import sky_background
from rpojax.vision.imaging.random_sky import Sky, random_sky
from rpojax.vision.pinhole import pinhole_intrinsics

background = jax.jit(sky_background.background, static_argnums=(2, 3))
square_intrinsics = jax.jit(pinhole_intrinsics, static_argnums=(1, 2))

SIZE = 64
ORBIT = 1.08


@pytest.fixture(scope="module")
def sky() -> Sky:
    """The sky of seed 0."""
    return random_sky()


def image(
    sky: Sky, boresight: np.ndarray, fov_deg: float = 10.0, sun: tuple[float, float, float] = (1, 0, 0)
) -> np.ndarray:
    """Image along a direction from an orbit above the x axis."""
    up = np.array([0.0, 1.0, 0.0]) if abs(boresight[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(boresight, up)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(boresight, x), boresight])
    intrinsics = square_intrinsics(jnp.asarray(np.radians(fov_deg)), SIZE, SIZE)
    parts = [jnp.asarray(v, jnp.float32) for v in (rotation, np.array([ORBIT, 0.0, 0.0]), np.array(sun), 0.0)]
    return np.asarray(background(sky, intrinsics, SIZE, SIZE, *parts))


def test_view_along_track_has_no_earth(sky: Sky) -> None:
    assert image(sky, np.array([0.0, 1.0, 0.0])).mean() < 0.01


def test_nadir_view_is_filled_and_dark_at_night(sky: Sky) -> None:
    assert image(sky, np.array([-1.0, 0.0, 0.0])).min() > 0.0
    np.testing.assert_array_equal(image(sky, np.array([-1.0, 0.0, 0.0]), sun=(-1, 0, 0)), 0.0)


def test_limb_is_at_dip_of_horizon(sky: Sky) -> None:
    dip = np.arccos(1.0 / ORBIT)
    direction = np.array([-np.sin(dip), np.cos(dip), 0.0])
    radiance = image(sky, direction, fov_deg=10.0).sum(axis=2)
    # The limb passes through the centre, with the Earth on one side.
    bright = (radiance > 0.03).mean()
    assert 0.4 < bright < 0.75


def test_binning_preserves_mean_star_radiance(sky: Sky) -> None:
    intrinsics = square_intrinsics(jnp.asarray(np.radians(40.0)), SIZE, SIZE)
    coarse = square_intrinsics(jnp.asarray(np.radians(40.0)), SIZE // 4, SIZE // 4)
    place = [jnp.asarray(v, jnp.float32) for v in (np.eye(3), np.array([1e3, 0, 0]), np.array([-1.0, 0, 0]), 0.0)]
    fine = np.asarray(background(sky, intrinsics, SIZE, SIZE, *place))
    binned = np.asarray(background(sky, coarse, SIZE // 4, SIZE // 4, *place, 4.0))
    assert fine.mean() > 0.0
    assert binned.mean() == pytest.approx(fine.mean(), rel=0.1)  # stars at the edge are clipped differently


def test_poles_are_not_interpolated_across(sky: Sky) -> None:
    earth, cloud = np.zeros_like(sky.earth), np.full_like(sky.cloud, -9.0)
    earth[-1] = 1.0
    plain = replace(sky, earth=jnp.asarray(earth), cloud=jnp.asarray(cloud))
    for height, bright in ((1.0, False), (-1.0, True)):
        rotation = np.array([[1.0, 0.0, 0.0], [0.0, -height, 0.0], [0.0, 0.0, -height]])
        position, sun = np.array([0.0, 0.0, height * ORBIT]), np.array([0.0, 0.0, height])
        parts = [jnp.asarray(v, jnp.float32) for v in (rotation, position, sun, 0.0)]
        intrinsics = square_intrinsics(jnp.asarray(np.radians(2.0)), SIZE, SIZE)
        radiance = np.asarray(background(plain, intrinsics, SIZE, SIZE, *parts))[..., 0]
        assert (radiance[SIZE // 2, SIZE // 2] > 0.3) == bright


def test_star_is_at_pixel_of_its_direction(sky: Sky) -> None:
    brightest = int(np.argmax(np.asarray(sky.star_radiance)))
    direction = np.asarray(sky.star_N[brightest], np.float64)
    nadir_cosine = np.asarray([-1.0, 0.0, 0.0]) @ direction
    if nadir_cosine > 0.3:
        pytest.skip("the brightest star is behind the Earth")
    radiance = image(sky, direction / np.linalg.norm(direction), sun=(-1, 0, 0)).sum(axis=2)
    row, column = np.unravel_index(np.argmax(radiance), radiance.shape)
    assert {row, column} <= {SIZE // 2 - 1, SIZE // 2}
