"""Synthetic textures of the Earth and a synthetic sprite."""

import numpy as np
import pytest

from rpojax.training.synthetic_data.scenery import earth_views
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite


@pytest.fixture(scope="session")
def earth() -> EarthTextures:
    """An Earth that is red at the longitudes of training and green at those of validation."""
    west, east = (round((longitude + 180.0) / 360.0 * 360) for longitude in earth_views.TRAINING_LONGITUDES_DEG)
    ground = np.zeros((180, 360, 3), np.uint8)
    ground[:, west:east, 0] = 255
    ground[:, east:, 1] = 255
    noise = np.random.default_rng(0).normal(size=(4, 1024, 1024)).astype(np.float32)
    return EarthTextures((ground,), earth_views.TRAINING_LONGITUDES_DEG, tuple(noise))


@pytest.fixture(scope="session")
def white_sprite() -> Sprite:
    """A white rectangle of 60 x 30 px."""
    light = np.full((30, 60, 3), 0.8, np.float32)
    return Sprite("plate", light, 0.1 * light, np.ones((30, 60), np.float32))
