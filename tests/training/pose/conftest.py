"""Views of a made target without a ray tracer: a light spot at each landmark, on a grey disc."""

import numpy as np
import pytest

from rpojax.training.pose.landmark_views import CHANNELS, LIGHTS, LandmarkViews, encode
from rpojax.training.pose.random_scenes import CANVAS_PX
from rpojax.training.pose.view_sampling import REGION_PX

COUNT = 4
_VIEWS = 12


@pytest.fixture(scope="session")
def spotted_views() -> LandmarkViews:
    """Views (12) of a disc with four spots, each at a random place."""
    rng = np.random.default_rng(0)
    places = REGION_PX * (0.5 + 0.22 * rng.uniform(-1.0, 1.0, (_VIEWS, COUNT, 2)))
    across, down = np.meshgrid(np.arange(REGION_PX) + 0.5, np.arange(REGION_PX) + 0.5)
    disc = np.hypot(across - 0.5 * REGION_PX, down - 0.5 * REGION_PX) < REGION_PX / 3.0
    codes = np.zeros((_VIEWS, REGION_PX, REGION_PX, CHANNELS), np.uint8)
    for view, spots in enumerate(places):
        light = 0.15 * disc
        for x, y in spots:
            light = light + 0.6 * np.exp(-0.5 * ((across - x) ** 2 + (down - y) ** 2) / 2.0**2)
        codes[view, ..., : 3 * LIGHTS] = encode(np.where(disc, light, 0.0))[..., None]
        codes[view, ..., -1] = 255 * disc
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    outline = 0.5 * REGION_PX + REGION_PX / 3.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return LandmarkViews(
        codes=codes,
        places=places,
        visible=np.ones((_VIEWS, COUNT), bool),
        outline=np.repeat(outline[None], _VIEWS, axis=0),
        center=0.5 * REGION_PX + rng.uniform(-60.0, 60.0, (_VIEWS, 2)),
        focal_px=np.full(_VIEWS, 400.0),
        half_frame=np.full(_VIEWS, np.tan(np.radians(11.0))),
        range_m=np.full(_VIEWS, 5.0),
    )


@pytest.fixture(scope="session")
def black_backdrops() -> np.ndarray:
    return np.zeros((2, CANVAS_PX, CANVAS_PX, 3), np.float32)
