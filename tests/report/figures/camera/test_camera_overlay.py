"""Annotated camera images: boxes and gates at their pixels, in their colours."""

import numpy as np
from synthetic_camera_frames import area_of, camera_frame

from rpojax.report.figures import camera_pictures
from rpojax.report.figures.colours import FILM_AMBER, FILM_BLUE, FILM_GREEN


def test_box_is_drawn_at_its_pixels_in_the_window() -> None:
    # 1.5 pixels of the drawing are one of the frame.
    assert area_of(FILM_GREEN, camera_pictures.annotated_frame(camera_frame())) == (60, 90, 150, 150)


def test_gate_is_drawn_around_the_predicted_centre() -> None:
    area = area_of(FILM_BLUE, camera_pictures.annotated_frame(camera_frame()))
    assert area is not None
    np.testing.assert_allclose(area, [213, 228, 303, 288], atol=1)


def test_rejected_boxes_have_another_colour() -> None:
    rejected, none = (
        camera_pictures.annotated_frame(camera_frame(box_accepted=False)),
        camera_pictures.annotated_frame(camera_frame(box_present=False, box_accepted=False)),
    )
    assert (area_of(FILM_GREEN, rejected), area_of(FILM_AMBER, rejected)) == (None, (60, 90, 150, 150))
    assert (area_of(FILM_GREEN, none), area_of(FILM_AMBER, none)) == (None, None)


def test_no_gate_is_drawn_for_a_target_behind_the_camera() -> None:
    nowhere = camera_frame(expected_px=np.full(3, np.nan), gate_px=np.full(2, np.nan))
    assert area_of(FILM_BLUE, camera_pictures.annotated_frame(nowhere)) is None


def test_negative_box_width_and_very_large_gate_are_drawn() -> None:
    drawn = camera_pictures.annotated_frame(
        camera_frame(box_px=np.array([168.0, 188.0, -3.0, 40.0]), gate_px=np.array([1e6, 1e6]))
    )
    # From 165 to 168 px across the frame, 55.5 to 60 of the drawing; the cross alone of a gate with its line outside.
    assert area_of(FILM_GREEN, drawn) == (55, 90, 60, 150)
    np.testing.assert_allclose(area_of(FILM_BLUE, drawn), [252, 252, 264, 264], atol=1)


def test_cameras_of_a_team_stand_side_by_side_with_their_names() -> None:
    one = np.asarray(camera_pictures.annotated_image(camera_frame()))
    cameras = {"near": camera_frame(), "far": camera_frame(box_present=False, box_accepted=False)}
    both = np.asarray(camera_pictures.annotated_image(camera_pictures.TeamFrame(cameras)))
    width = one.shape[1]
    assert both.shape == (one.shape[0], 2 * width + 4, 3)
    pixels = both.shape[0] - width
    np.testing.assert_array_equal(both[pixels:, :width], one[pixels:])
    # The first line of text begins with a name.
    assert not np.array_equal(both[:pixels, :width], one[:pixels])
    left, right = (np.ascontiguousarray(part) for part in (both[:, :width], both[:, width + 4 :]))
    assert area_of(FILM_GREEN, left) == (60, 90, 150, 150)
    assert area_of(FILM_GREEN, right) is None
