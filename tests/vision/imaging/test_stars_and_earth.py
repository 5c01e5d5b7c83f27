"""Stars and Earth are where they are for the camera's attitude."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.vision.imaging.sky_background import background
from rpojax.vision.imaging.sky_maps import Sky, random_sky
from rpojax.vision.pinhole import pinhole_intrinsics

SIZE = 64
ORBIT = 1.08


@pytest.fixture(scope="module")
def around() -> Sky:
    """The sky of seed 0."""
    return random_sky()


def picture(
    around: Sky, boresight: np.ndarray, fov_deg: float = 10.0, sun: tuple[float, float, float] = (1, 0, 0)
) -> np.ndarray:
    """Picture from above the x axis along a direction."""
    up = np.array([0.0, 1.0, 0.0]) if abs(boresight[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(boresight, up)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(boresight, x), boresight])
    optics = pinhole_intrinsics(jnp.asarray(np.radians(fov_deg)), SIZE, SIZE)
    parts = [jnp.asarray(v, jnp.float32) for v in (rotation, np.array([ORBIT, 0.0, 0.0]), np.array(sun), 0.0)]
    return np.asarray(background(around, optics, SIZE, SIZE, *parts))


def test_the_earth_stays_out_of_a_view_along_the_track(around: Sky) -> None:
    assert picture(around, np.array([0.0, 1.0, 0.0])).mean() < 0.01


def test_the_earth_fills_a_view_downwards_and_is_dark_at_night(around: Sky) -> None:
    assert picture(around, np.array([-1.0, 0.0, 0.0])).min() > 0.0
    np.testing.assert_array_equal(picture(around, np.array([-1.0, 0.0, 0.0]), sun=(-1, 0, 0)), 0.0)


def test_the_limb_is_at_the_dip_of_the_horizon(around: Sky) -> None:
    dip = np.arccos(1.0 / ORBIT)
    direction = np.array([-np.sin(dip), np.cos(dip), 0.0])
    seen = picture(around, direction, fov_deg=10.0).sum(axis=2)
    # The camera's x axis is along y or -x: the limb goes through the middle, the Earth on one side of it.
    bright = (seen > 0.03).mean()
    assert 0.4 < bright < 0.75


def test_stars_keep_their_light_where_pixels_are_binned(around: Sky) -> None:
    optics = pinhole_intrinsics(jnp.asarray(np.radians(40.0)), SIZE, SIZE)
    coarse = pinhole_intrinsics(jnp.asarray(np.radians(40.0)), SIZE // 4, SIZE // 4)
    place = [jnp.asarray(v, jnp.float32) for v in (np.eye(3), np.array([1e3, 0, 0]), np.array([-1.0, 0, 0]), 0.0)]
    fine = np.asarray(background(around, optics, SIZE, SIZE, *place))
    binned = np.asarray(background(around, coarse, SIZE // 4, SIZE // 4, *place, 4.0))
    assert fine.mean() > 0.0
    assert binned.mean() == pytest.approx(fine.mean(), rel=0.1)  # stars at the rim are cut otherwise


def test_the_poles_are_their_own_ground(around: Sky) -> None:
    """The white of Antarctica is not mixed into the north pole."""
    plain = replace(around, earth=jnp.zeros_like(around.earth).at[-1].set(1.0), cloud=jnp.full_like(around.cloud, -9.0))
    for height, bright in ((1.0, False), (-1.0, True)):
        rotation = np.array([[1.0, 0.0, 0.0], [0.0, -height, 0.0], [0.0, 0.0, -height]])
        position, sun = np.array([0.0, 0.0, height * ORBIT]), np.array([0.0, 0.0, height])
        parts = [jnp.asarray(v, jnp.float32) for v in (rotation, position, sun, 0.0)]
        optics = pinhole_intrinsics(jnp.asarray(np.radians(2.0)), SIZE, SIZE)
        seen = np.asarray(background(plain, optics, SIZE, SIZE, *parts))[..., 0]
        assert (seen[SIZE // 2, SIZE // 2] > 0.3) == bright


def test_a_star_falls_on_the_pixel_of_its_direction(around: Sky) -> None:
    brightest = int(np.argmax(np.asarray(around.star_radiance)))
    direction = np.asarray(around.star_N[brightest], np.float64)
    from_the_dark = np.asarray([-1.0, 0.0, 0.0]) @ direction
    if from_the_dark > 0.3:
        pytest.skip("the brightest star is behind the Earth")
    seen = picture(around, direction / np.linalg.norm(direction), sun=(-1, 0, 0)).sum(axis=2)
    row, column = np.unravel_index(np.argmax(seen), seen.shape)
    assert {row, column} <= {SIZE // 2 - 1, SIZE // 2}
