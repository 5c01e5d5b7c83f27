"""Random views of a target."""

import numpy as np

from rpojax.training.synthetic_data import random_views
from rpojax.training.synthetic_data.ray_traced_views import Views


def test_views_are_within_phase_limit_and_brighter_at_small_phase(views: Views) -> None:
    away = views.position / np.linalg.norm(views.position, axis=1, keepdims=True)
    phase = np.degrees(np.arccos(np.sum(away * views.sun, axis=1)))
    assert phase.max() <= random_views.PHASE_LIMIT_DEG
    brightness = np.array([rgb[alpha > 0.999].mean() for rgb, alpha in zip(views.rgb, views.alpha, strict=True)])
    assert brightness[phase < 45.0].mean() > 2.0 * brightness[phase > 80.0].mean()
    assert (views.rgb[views.alpha == 0.0] == 0.0).all()
