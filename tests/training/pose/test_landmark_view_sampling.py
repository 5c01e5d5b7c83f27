"""Random views: geometry of camera and region, ranges, and streams that share no view."""

import dataclasses

import numpy as np
import pytest

from rpojax.training.pose.view_sampling import (
    HELD_OUT_STREAM,
    REGION_PX,
    LandmarkView,
    LandmarkViewSampling,
    region_of,
    sample_view,
)

_PORT = np.array([0.0, 0.0, 1.0])
_CORNERS = np.array([[x, y, z] for x in (-0.25, 0.25) for y in (-0.8, 0.8) for z in (-0.3, 0.3)])


@pytest.fixture(scope="module")
def drawn() -> list[LandmarkView]:
    return [sample_view(LandmarkViewSampling(300, seed=3), index, _PORT) for index in range(300)]


def test_cameras_are_right_handed_and_have_the_target_in_their_frame(drawn: list[LandmarkView]) -> None:
    for view in drawn:
        np.testing.assert_allclose(view.rotation @ view.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(view.rotation) == pytest.approx(1.0)
        origin = -view.rotation @ view.position
        assert origin[2] > 0.0
        assert np.linalg.norm(origin) == pytest.approx(view.range_m)
        np.testing.assert_allclose(view.tangents(np.zeros((1, 3)))[0], origin[:2] / origin[2])
        assert np.abs(view.tangents(np.zeros((1, 3)))).max() < view.half_frame


def test_ranges_are_even_in_their_logarithm_and_some_views_are_before_the_port(drawn: list[LandmarkView]) -> None:
    ranges = np.array([view.range_m for view in drawn])
    assert ranges.min() >= 1.2
    assert ranges.max() <= 20.0
    before = np.array([view.position @ _PORT > np.cos(np.radians(25.0)) * view.range_m for view in drawn])
    assert before[ranges < 4.0].mean() > 0.15
    far = ranges[~before]
    share = np.mean(np.log(far) < 0.5 * np.log(1.2 * 20.0))
    assert 0.4 < share < 0.6


def test_a_region_has_all_of_the_target_that_any_roll_shows(drawn: list[LandmarkView]) -> None:
    for view in drawn:
        region = region_of(view, _CORNERS)
        tangents = view.tangents(_CORNERS)
        in_reach = np.linalg.norm(tangents, axis=1) < np.sqrt(2.0) * view.half_frame
        pixels = region.to_pixels(tangents)[in_reach]
        assert ((pixels >= -1e-9) & (pixels <= REGION_PX + 1e-9)).all()
        step = region.to_pixels(np.array([[0.01, 0.0]])) - region.to_pixels(np.zeros((1, 2)))
        np.testing.assert_allclose(step[0], [0.01 * region.focal_px, 0.0], atol=1e-9)


def test_no_held_back_view_is_one_of_a_training() -> None:
    training = LandmarkViewSampling(5, seed=7)
    held_back = dataclasses.replace(training, stream=HELD_OUT_STREAM)
    positions = [
        tuple(sample_view(sampling, index, None).position) for sampling in (training, held_back) for index in range(5)
    ]
    assert len(set(positions)) == 10
    again = sample_view(dataclasses.replace(training, count=99), 2, None)
    np.testing.assert_array_equal(again.position, positions[2])


def test_the_sun_is_never_behind_the_target_and_the_lamp_is_beside_the_camera(drawn: list[LandmarkView]) -> None:
    for view in drawn:
        away = view.position / view.range_m
        assert (np.degrees(np.arccos(view.suns @ away)) <= 130.0 + 1e-6).all()
        assert np.linalg.norm(view.lamp - view.position) <= 0.18 + 1e-9
