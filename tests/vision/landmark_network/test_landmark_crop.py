"""The square crop around a box: where its pixels come from, and what is beyond the frame."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.landmark_network.landmark_crop import CROP_PX, crop_picture, crop_place, to_crop, to_picture

_BOXES = [(20.0, 30.0, 90.0, 70.0), (0.0, 0.0, 128.0, 128.0), (60.3, 41.7, 84.2, 99.1)]
_crop = jax.jit(crop_picture)
_WHOLE = jnp.array([0.0, 0.0, 128.0, 128.0], jnp.float32)


def _spot(x: float, y: float, sigma: float = 2.0) -> jnp.ndarray:
    """A picture (128, 128, 3) with a round spot."""
    across, down = np.meshgrid(np.arange(128) + 0.5, np.arange(128) + 0.5)
    light = np.exp(-0.5 * ((across - x) ** 2 + (down - y) ** 2) / sigma**2)
    return jnp.asarray(np.repeat(light[..., None], 3, axis=2), jnp.float32)


@pytest.mark.parametrize("box", _BOXES)
@pytest.mark.parametrize("at", [(70.0, 55.0), (66.25, 60.5)])
def test_a_spot_is_in_the_crop_where_its_place_is(box: tuple[float, ...], at: tuple[float, float]) -> None:
    place = crop_place(jnp.array(box, jnp.float32))
    shown = np.asarray(_crop(_spot(*at), place, _WHOLE)[..., 0])
    light = np.maximum(shown - shown.min() - 0.2 * np.ptp(shown), 0.0)
    middle = np.arange(CROP_PX) + 0.5
    found = [(light.sum(axis=axis) * middle).sum() / light.sum() for axis in (0, 1)]
    np.testing.assert_allclose(found, to_crop(jnp.array([at], jnp.float32), place)[0], atol=0.05)


@pytest.mark.parametrize("box", _BOXES)
def test_places_go_into_the_crop_and_back(box: tuple[float, ...]) -> None:
    points = jnp.asarray(np.random.default_rng(0).uniform(-20.0, 150.0, (9, 2)).astype(np.float32))
    place = crop_place(jnp.array(box, jnp.float32))
    np.testing.assert_allclose(to_picture(to_crop(points, place), place), points, atol=1e-4)
    # All of the box is in the crop, with something around it.
    corners = to_crop(jnp.array(box, jnp.float32).reshape(2, 2), place)
    assert float(corners.min()) > 0.03 * CROP_PX
    assert float(corners.max()) < 0.97 * CROP_PX


def test_beyond_the_frame_all_channels_are_zero() -> None:
    place = crop_place(jnp.array([90.0, 40.0, 128.0, 100.0], jnp.float32))
    crop = np.asarray(_crop(_spot(110.0, 70.0) + 0.3, place, _WHOLE))
    column = float(place.low[0]) + (np.arange(CROP_PX) + 0.5) * float(place.side) / CROP_PX
    assert (crop[:, column > 128.0] == 0.0).all()
    assert (crop[:, column < 128.0, 3] == 1.0).all()
    assert 0 < (column > 128.0).sum() < CROP_PX // 2


def test_a_brighter_picture_gives_the_same_crop() -> None:
    place = crop_place(jnp.array(_BOXES[0], jnp.float32))
    picture = _spot(50.0, 50.0, 9.0)
    np.testing.assert_allclose(_crop(0.4 * picture + 0.1, place, _WHOLE), _crop(picture, place, _WHOLE), atol=1e-3)


def test_a_picture_without_contrast_stays_finite_and_small() -> None:
    place = crop_place(jnp.array(_BOXES[0], jnp.float32))
    crop = np.asarray(_crop(jnp.full((128, 128, 3), 0.2, jnp.float32), place, _WHOLE))
    assert np.abs(crop[..., :3]).max() < 1e-3
