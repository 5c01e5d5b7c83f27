"""Backdrops of every kind."""

import numpy as np
import pytest

from rpojax.training.synthetic_data.scenery import backdrops, earth_views
from rpojax.training.synthetic_data.scenery.backdrops import paint_backdrop, paint_flight_backdrop
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures


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
    other = EarthTextures(earth.ground, earth_views.VALIDATION_LONGITUDES_DEG, earth.noise)
    greens = [paint_backdrop(np.random.default_rng([4, i]), "earth", other, 48) for i in range(20)]
    assert max(float((p[..., 1] - p[..., 0]).max()) for p in greens) > 0.3


def test_the_flight_backdrop_has_the_earth_where_the_rays_of_the_view_meet_it(earth: EarthTextures) -> None:
    for index in range(8):
        rng = np.random.default_rng([5, index])
        image = paint_flight_backdrop(rng, earth, 48)
        rng = np.random.default_rng([5, index])
        view = earth_views.random_earth_view(rng, earth, 48, bool(rng.random() < 0.4), sun_height=(-0.2, 1.0))
        ground = earth_views.ground_image(rng, earth, view, 0.5)
        lit = ground.hit & (ground.point @ view.sun > 0.05)
        assert (image[lit].max(axis=1) > 0.0).all()
        space = ~ground.hit & (ground.height > 0.05)
        assert (image[space].max(axis=1) > 1e-3).sum() < 0.1 * max(space.sum(), 1)


def test_clouds_are_brighter_towards_the_sun(earth: EarthTextures) -> None:
    # A cloud that grows thicker to the right is dark there if the Sun is on the right: its slope faces left.
    for index in range(10):
        rng = np.random.default_rng([7, index])
        view = earth_views.random_earth_view(rng, earth, 48, limb=False, sun_height=(0.2, 0.6))
        ground = earth_views.ground_image(rng, earth, view, 0.5)
        down, right = np.gradient(ground.clouds)
        edge = (ground.clouds > 0.05) & (ground.clouds < 0.3)
        away = right * (view.axes[0] @ view.sun) + down * (view.axes[1] @ view.sun)
        if edge.sum() > 50 and ground.cloud_light.std() > 0.01:
            assert np.corrcoef(away[edge], ground.cloud_light[edge])[0, 1] < 0.0
