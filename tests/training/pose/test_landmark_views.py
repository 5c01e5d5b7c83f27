"""Ray-traced regions: where the target is in them, which landmarks are in sight, and what a folder keeps."""

from pathlib import Path

import numpy as np
import pytest

from rpojax.training.pose.landmark_views import (
    DECODED,
    LIGHTS,
    LandmarkRayTracer,
    convex_corners,
    encode,
    trace_landmark_views,
)
from rpojax.training.pose.view_sampling import REGION_PX, LandmarkViewSampling, region_of, sample_view
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh
from rpojax.vision.surface.landmark_selection import select_landmarks
from rpojax.vision.surface.landmarks import Landmarks

_SAMPLING = LandmarkViewSampling(3, seed=2, range_m=(1.5, 8.0), samples=4)


@pytest.fixture(scope="module")
def corners(box: TargetMesh) -> Landmarks:
    """The eight corners of the box."""
    return select_landmarks(np.concatenate([part.vertices[part.faces] for part in box.parts]), 8, None)


def test_the_target_is_where_the_camera_projects_it(box: TargetMesh, corners: Landmarks) -> None:
    tracer, hull = LandmarkRayTracer(box, 4), convex_corners(box)
    assert len(hull) == 8
    checked = 0
    for index in range(12):
        view = sample_view(_SAMPLING, index, None)
        region = region_of(view, hull)
        pixels = region.to_pixels(view.tangents(hull))
        if pixels.min() < 0.0 or pixels.max() > REGION_PX:
            continue
        film = tracer.trace(view, region, index)
        covered = film[..., -1] > 0.5
        for axis in (0, 1):
            shown = np.flatnonzero(covered.any(axis=axis))
            expected = pixels[:, axis].min(), pixels[:, axis].max() - 1.0
            np.testing.assert_allclose((shown[0], shown[-1]), expected, atol=1.6)
        # Uniform light reaches all of a convex body, by some of the few samples.
        assert (film[covered][:, 3 * LIGHTS - 3] > 0.0).mean() > 0.95
        checked += 1
    assert checked >= 6


def test_corners_of_a_box_are_in_sight_if_one_of_their_faces_is(box: TargetMesh, corners: Landmarks) -> None:
    tracer, half = LandmarkRayTracer(box, 1), np.array([0.5, 0.3, 0.2])
    for index in range(12):
        view = sample_view(_SAMPLING, index, None)
        places = np.asarray(corners.positions)
        # A face is seen from beyond its plane.
        expected = (np.sign(places) * view.position > half).any(axis=1)
        np.testing.assert_array_equal(tracer.visible(view, corners, 1.2), expected)


def test_lights_that_are_not_asked_for_are_dark_and_the_others_the_same(box: TargetMesh) -> None:
    tracer = LandmarkRayTracer(box, 2)
    view = sample_view(_SAMPLING, 0, None)
    region = region_of(view, convex_corners(box))
    whole = tracer.trace(view, region, 5)
    lamp = tracer.trace(view, region, 5, np.array([False, False, True, False]))
    np.testing.assert_array_equal(lamp[..., 6:9], whole[..., 6:9])
    assert (lamp[..., :6] == 0.0).all()
    assert (lamp[..., 9:12] == 0.0).all()
    assert whole[..., 6:9].max() > 0.05


def test_traced_views_are_kept_and_traced_on(box: TargetMesh, corners: Landmarks, tmp_path: Path) -> None:
    whole = trace_landmark_views(box, corners, _SAMPLING, tmp_path / "whole")
    assert whole.codes.shape == (3, REGION_PX, REGION_PX, 3 * LIGHTS + 1)
    assert len(list((tmp_path / "whole").iterdir())) == 1
    calls: list[int] = []
    again = trace_landmark_views(box, corners, _SAMPLING, tmp_path / "whole", lambda done, total: calls.append(done))
    assert calls == [3]  # the block as a whole
    for name, values in vars(whole).items():
        np.testing.assert_array_equal(getattr(again, name), values)
    other = LandmarkViewSampling(3, seed=3, range_m=(1.5, 8.0), samples=4)
    calls.clear()
    trace_landmark_views(box, corners, other, tmp_path / "whole", lambda done, total: calls.append(done))
    assert calls == [1, 2, 3, 3]  # another seed is traced anew


def test_codes_keep_dark_radiance_to_a_few_percent() -> None:
    radiance = np.geomspace(0.01, 5.0, 50)
    np.testing.assert_allclose(DECODED[encode(radiance)], radiance, rtol=0.08)
    assert DECODED[encode(np.array([0.0, -1.0]))].max() == 0.0
