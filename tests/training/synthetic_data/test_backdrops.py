"""Backdrops of every kind."""

import numpy as np
import pytest

from rpojax.training.synthetic_data import (
    backdrops,
    earth_textures,
)
from rpojax.training.synthetic_data.backdrops import paint_backdrop
from rpojax.training.synthetic_data.earth_textures import EarthTextures


@pytest.mark.parametrize("kind", backdrops.BACKDROP_KINDS)
def test_backdrops_are_finite_and_reproducible(earth: EarthTextures, kind: str) -> None:
    images = [paint_backdrop(np.random.default_rng([3, index]), kind, earth, 48) for index in range(6)]
    assert all(p.shape == (48, 48, 3) and p.dtype == np.float32 and np.isfinite(p).all() for p in images)
    assert min(p.min() for p in images) >= -1e-6
    assert (kind == "black") == (max(p.max() for p in images) == 0.0)
    np.testing.assert_array_equal(images[2], paint_backdrop(np.random.default_rng([3, 2]), kind, earth, 48))


def test_training_backdrops_exclude_validation_longitudes(earth: EarthTextures) -> None:
    for index in range(20):
        image = paint_backdrop(np.random.default_rng([4, index]), "earth", earth, 48)
        # Clouds are grey, and air has little more green than red.
        assert (image[..., 1] - image[..., 0]).max() < 0.15
    other = EarthTextures(earth.ground, earth_textures.VALIDATION_LONGITUDES_DEG, earth.noise)
    greens = [paint_backdrop(np.random.default_rng([4, i]), "earth", other, 48) for i in range(20)]
    assert max(float((p[..., 1] - p[..., 0]).max()) for p in greens) > 0.3
