"""Boxes and numbers of spacecraft of composites."""

import numpy as np

from rpojax.training.detector.average_precision import pair_kind
from rpojax.training.synthetic_data.composites import GENERATORS, random_composite
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite


def test_box_of_composite_surrounds_bright_pixels(earth: EarthTextures, white_sprite: Sprite) -> None:
    matching = 0
    for index in range(120):
        composite = random_composite(np.random.default_rng([1, index]), [white_sprite], earth, 128)
        assert composite.image.dtype == np.uint8
        assert (composite.boxes >= 0.0).all()
        assert (composite.boxes <= 128.0).all()
        if composite.background != "black" or len(composite.boxes) != 1:
            continue
        box = composite.boxes[0]
        bright = composite.image.min(axis=2) > 0.5 * np.quantile(composite.image.min(axis=2)[box_slice(box)], 0.9)
        rows, columns = (np.nonzero(bright.any(axis=axis))[0] for axis in (1, 0))
        if bright.sum() > 1.3 * np.prod(box[2:] - box[:2]):
            continue  # with an artefact as bright
        # Blur moves the edge by less than a pixel.
        edges = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
        matching += np.abs(np.array(edges) - box).max() <= 1.5
    assert matching >= 8


def box_slice(box: np.ndarray) -> tuple[slice, slice]:
    left, top, right, bottom = (int(edge) for edge in box)
    return slice(top, bottom + 1), slice(left, right + 1)


def test_fifth_of_composites_is_empty_and_some_have_two_spacecraft(earth: EarthTextures, white_sprite: Sprite) -> None:
    numbers = [
        len(random_composite(np.random.default_rng([2, i]), [white_sprite], earth, 64).boxes) for i in range(250)
    ]
    # Four standard deviations; some more are empty where no spacecraft is visible.
    assert 0.1 <= np.mean(np.array(numbers) == 0) <= 0.34
    assert numbers.count(2) >= 3


def test_second_generator_has_pairs_that_are_near_or_overlap(earth: EarthTextures, white_sprite: Sprite) -> None:
    composites = [
        random_composite(np.random.default_rng([3, index]), [white_sprite], earth, 64, GENERATORS[2])
        for index in range(150)
    ]
    kinds = [pair_kind(composite.boxes, 4.0) for composite in composites]
    # A fifth of those with spacecraft are near pairs, of which about half overlap: four standard deviations.
    assert 5 <= kinds.count("overlapping") <= 35
    assert kinds.count("near") >= 2
    for composite in composites:
        assert composite.known.shape == composite.boxes.shape
        assert composite.mask.dtype == np.uint8
        assert composite.mask.shape == (64, 64)
        covered = np.argwhere(composite.mask > 127)
        for row, column in covered[:: max(1, len(covered) // 20)]:
            left, top, right, bottom = composite.boxes.T
            assert ((left <= column + 1) & (column <= right) & (top <= row + 1) & (row <= bottom)).any()


def test_first_generator_has_no_overlapping_pairs(earth: EarthTextures, white_sprite: Sprite) -> None:
    for index in range(150):
        composite = random_composite(np.random.default_rng([4, index]), [white_sprite], earth, 64)
        assert pair_kind(composite.boxes, 4.0) != "overlapping"
        assert composite.background != "city"
