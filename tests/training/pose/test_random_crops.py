"""Crops of random scenes: labels follow the picture through roll, scale, crop and turn."""

import jax.numpy as jnp
import numpy as np

from rpojax.training.pose.landmark_loss import crops_of
from rpojax.training.pose.landmark_views import LandmarkViews
from rpojax.training.pose.random_crops import random_crops, resample
from rpojax.training.pose.random_scenes import CANVAS_PX, random_scene
from rpojax.vision.landmark_network.landmark_crop import CROP_PX, crop_picture, crop_place, to_crop

_WHOLE = jnp.array([0.0, 0.0, CANVAS_PX, CANVAS_PX], jnp.float32)


def test_spots_of_the_picture_are_where_the_labels_say(
    spotted_views: LandmarkViews, black_backdrops: np.ndarray
) -> None:
    errors = []
    for turns in (1, 4):
        batch = random_crops(spotted_views, black_backdrops, np.arange(12), np.random.default_rng(1), turns)
        assert batch.codes.shape == (12 * turns, CROP_PX, CROP_PX, 3)
        for codes, places, shown in zip(batch.codes, batch.places, batch.in_crop, strict=True):
            light = codes.astype(float).mean(axis=2)
            for index in np.flatnonzero(shown):
                apart = np.linalg.norm(np.delete(places, index, axis=0) - places[index], axis=1).min()
                x, y = places[index]
                # Well away from other spots and from the edge of the disc and the frame.
                if apart < 14.0 or not (8.0 < x < CROP_PX - 8.0 and 8.0 < y < CROP_PX - 8.0):
                    continue
                left, top = round(x - 5.5), round(y - 5.5)
                part = light[top : top + 11, left : left + 11]
                part = np.maximum(part - np.median(part) - 0.3 * (part.max() - np.median(part)), 0.0)
                if part.max() < 20.0 or (light[top : top + 11, left : left + 11] < 3.0).any():
                    continue
                middle = np.arange(11) + 0.5
                found = [left + (part.sum(axis=0) * middle).sum() / part.sum()]
                found.append(top + (part.sum(axis=1) * middle).sum() / part.sum())
                errors.append(np.array(found) - places[index])
    assert len(errors) > 60
    assert np.abs(np.mean(errors, axis=0)).max() < 0.08  # no shift by half a pixel
    assert np.quantile(np.linalg.norm(errors, axis=1), 0.95) < 0.7


def test_pictures_are_rolled_and_never_mirrored(spotted_views: LandmarkViews, black_backdrops: np.ndarray) -> None:
    angles = []
    for seed in range(20):
        framing = random_scene(spotted_views, black_backdrops, 0, np.random.default_rng(seed)).framing
        turn = framing.matrix[:, :2] / framing.scale
        np.testing.assert_allclose(turn @ turn.T, np.eye(2), atol=1e-9)
        assert np.linalg.det(turn) > 0.99
        angles.append(np.arctan2(turn[1, 0], turn[0, 0]))
    assert np.ptp(angles) > 4.0


def test_a_crop_is_resampled_as_the_network_does_it() -> None:
    x, y = np.meshgrid(np.arange(CANVAS_PX), np.arange(CANVAS_PX))
    waves = [127.0 + 120.0 * np.sin(a * x + b * y) for a, b in ((0.2, 0.1), (-0.05, 0.3), (0.25, -0.2))]
    picture = np.stack(waves, axis=2).astype(np.uint8)
    for box in ((60.0, 50.0, 100.0, 120.0), (40.0, 40.0, 150.0, 150.0)):
        place = crop_place(jnp.array(box, jnp.float32))
        mine = resample(picture, np.asarray(place.low, float), float(place.side)).astype(float)
        theirs = np.asarray(crop_picture(jnp.asarray(picture.astype(np.float32) / 255.0), place, _WHOLE))[..., :3]
        scaled = (mine - mine.mean()) / mine.std()
        assert np.abs(scaled - theirs).mean() < 0.03
        assert np.abs(scaled - theirs).max() < 0.25


def test_landmarks_beyond_the_frame_are_not_in_the_crop(
    spotted_views: LandmarkViews, black_backdrops: np.ndarray
) -> None:
    batch = random_crops(spotted_views, black_backdrops, np.repeat(np.arange(12), 6), np.random.default_rng(2))
    cut = 0
    for inside, places, shown in zip(batch.inside, batch.places, batch.in_crop, strict=True):
        for (x, y), is_shown in zip(places, shown, strict=True):
            column, row = int(np.floor(x)), int(np.floor(y))
            if is_shown:
                # The frame cuts through pixels.
                near = inside[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
                assert near.any()
            elif 0 <= column < CROP_PX and 0 <= row < CROP_PX:
                assert not inside[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].all()
                cut += 1
    assert cut > 10
    crops = np.asarray(crops_of(batch))
    assert (crops[..., :3][batch.inside == 0] == 0.0).all()


def test_the_same_seed_gives_the_same_crops(spotted_views: LandmarkViews, black_backdrops: np.ndarray) -> None:
    first, second = (
        random_crops(spotted_views, black_backdrops, np.arange(3), np.random.default_rng([4, 5])) for _ in range(2)
    )
    np.testing.assert_array_equal(first.codes, second.codes)
    np.testing.assert_array_equal(first.places, second.places)
    third = random_crops(spotted_views, black_backdrops, np.arange(3), np.random.default_rng([4, 6]))
    assert (third.codes != first.codes).any()


def test_places_in_the_crop_are_those_of_the_scene() -> None:
    place = crop_place(jnp.array([50.0, 60.0, 110.0, 100.0], jnp.float32))
    corner = to_crop(place.low[None], place)
    np.testing.assert_allclose(corner, 0.0, atol=1e-5)
