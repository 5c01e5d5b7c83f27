"""Films and strips: the right moments, and every line where it belongs."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_camera_frames import camera_frame

from rpojax.errors import OutputError, RpojaxError
from rpojax.report.figures import camera_pictures


@pytest.mark.parametrize("codec", camera_pictures.CODECS)
def test_film_contains_every_frame(tmp_path: Path, codec: str) -> None:
    import cv2

    path = camera_pictures.write_film(
        [camera_frame(), camera_frame(box_present=False), camera_frame()], tmp_path / "seen.mp4", codec
    )
    capture = cv2.VideoCapture(str(path))
    found, picture = capture.read()
    assert found
    expected = camera_pictures.annotated_frame(camera_frame())
    assert picture.shape == expected.shape
    assert expected.shape[0] % 2 == expected.shape[1] % 2 == 0
    # Lossy, but red is red and blue is blue.
    assert np.abs(picture[..., ::-1].astype(float) - expected).mean() < 6.0
    assert [capture.read()[0] for _ in range(3)] == [True, True, False]
    assert list(tmp_path.iterdir()) == [path]


def test_h264_film_has_its_index_in_front_and_reproducible_bytes(tmp_path: Path) -> None:
    one, two = (
        camera_pictures.write_film([camera_frame(), camera_frame()], tmp_path / name, "h264").read_bytes()
        for name in ("1.mp4", "2.mp4")
    )
    assert b"avc1" in one
    assert one.index(b"moov") < one.index(b"mdat")
    assert one == two


def test_unknown_codec_and_missing_package_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OutputError, match=r"codec: found 'av1', expected vp9 or h264"):
        camera_pictures.check_codec("av1")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    camera_pictures.check_codec("vp9")
    with pytest.raises(RpojaxError, match=r"imageio_ffmpeg: not installed, expected: pip install 'rpojax\[viz\]'"):
        camera_pictures.check_codec("h264")


def test_interrupted_film_leaves_the_existing_file(tmp_path: Path) -> None:
    path = tmp_path / "seen.mp4"
    path.write_text("mine")

    def broken() -> Any:
        yield camera_frame()
        raise OutputError("no more")

    with pytest.raises(OutputError, match="no more"):
        camera_pictures.write_film(broken(), path)
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]
