"""Random views of a target."""

import numpy as np

from rpojax.training.synthetic_data import random_views
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.training.synthetic_data.random_views import ViewSampling
from rpojax.training.synthetic_data.ray_traced_views import Views


def test_views_are_within_phase_limit_and_brighter_at_small_phase(views: Views) -> None:
    away = views.position / np.linalg.norm(views.position, axis=1, keepdims=True)
    phase = np.degrees(np.arccos(np.sum(away * views.sun, axis=1)))
    assert phase.max() <= random_views.PHASE_LIMIT_DEG
    brightness = np.array([rgb[alpha > 0.999].mean() for rgb, alpha in zip(views.sunlit, views.alpha, strict=True)])
    assert brightness[phase < 45.0].mean() > 2.0 * brightness[phase > 80.0].mean()
    assert (views.sunlit[views.alpha == 0.0] == 0.0).all()


def test_glints_are_mirrored_by_a_face_of_the_box(box: TargetMesh) -> None:
    poses = random_views.sample_views(box, ViewSampling(40, glint_fraction=1.0, glint_spread_deg=3.0))
    away = poses.position / np.linalg.norm(poses.position, axis=1, keepdims=True)
    # The faces of the box are along the axes: a mirror changes the sign of two components.
    mirrored = away[:, None, :] * (2.0 * np.eye(3) - 1.0)[None]
    cosine = np.sum(mirrored * poses.sun[:, None, :], axis=2).max(axis=1)
    assert np.degrees(np.arccos(np.minimum(cosine, 1.0))).max() <= 3.0 + 1e-6
    plain = random_views.sample_views(box, ViewSampling(40))
    np.testing.assert_array_equal(plain.position, poses.position)
    np.testing.assert_array_equal(plain.fill, poses.fill)
