"""Films and strips: the right moments, and every line where it belongs."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rpojax.errors import OutputError, RpojaxError
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.figures import camera_film
from rpojax.report.figures.colours import FILM_AMBER, FILM_BLUE, FILM_GREEN

SIDE = 128
HEAD = 51
"""Height of the text above a picture [px]."""


def shot(**changes: Any) -> camera_film.CameraFrame:
    """A black picture of the middle of a frame of 512 px, binned by two, and a box in it."""
    seen = {
        "time_s": 12.0,
        "range_m": 30.2,
        "mode": np.int8(Mode.LOOK),
        "observable": True,
        "box_present": True,
        "box_accepted": True,
        "box_truncated": False,
        "box_score": 0.93,
        "box_px": np.array([168.0, 188.0, 60.0, 40.0]),
        "expected_px": np.array([300.0, 300.0, 20.0]),
        "gate_px": np.array([30.0, 20.0]),
        "window_px": np.array([128.0, 128.0, 256.0]),
    }
    return np.zeros((SIDE, SIDE, 3), np.uint8), {name: np.asarray(value) for name, value in (seen | changes).items()}


def area_of(color: str, sheet: np.ndarray) -> tuple[int, ...] | None:
    """Left, top, right and bottom pixel of a colour in the picture, which lies below its text and above its legend."""
    rgb = [int(color[place : place + 2], 16) for place in (1, 3, 5)]
    rows, columns = np.nonzero((sheet[HEAD : HEAD + 3 * SIDE] == rgb).all(axis=2))
    if len(rows) == 0:
        return None
    return tuple(int(value) for value in (columns.min(), rows.min(), columns.max(), rows.max()))


def test_a_box_is_drawn_where_it_is_in_its_window() -> None:
    # 1.5 pixels of the drawing are one of the frame.
    assert area_of(FILM_GREEN, camera_film.annotated_frame(*shot())) == (60, 90, 150, 150)


def test_what_was_expected_is_drawn_with_its_gate() -> None:
    left, top, right, bottom = area_of(FILM_BLUE, camera_film.annotated_frame(*shot())) or ()
    np.testing.assert_allclose([left, top, right, bottom], [213, 228, 303, 288], atol=1)


def test_a_refused_box_has_another_colour_and_none_has_none() -> None:
    refused, none = (
        camera_film.annotated_frame(*shot(box_accepted=False)),
        camera_film.annotated_frame(*shot(box_present=False, box_accepted=False)),
    )
    assert (area_of(FILM_GREEN, refused), area_of(FILM_AMBER, refused)) == (None, (60, 90, 150, 150))
    assert (area_of(FILM_GREEN, none), area_of(FILM_AMBER, none)) == (None, None)


def test_a_target_behind_the_camera_is_expected_nowhere() -> None:
    nowhere = shot(expected_px=np.full(3, np.nan), gate_px=np.full(2, np.nan))
    assert area_of(FILM_BLUE, camera_film.annotated_frame(*nowhere)) is None


def test_a_box_that_is_inside_out_and_a_gate_as_wide_as_the_sky_are_drawn() -> None:
    camera_film.annotated_frame(*shot(box_px=np.array([168.0, 188.0, -3.0, 40.0]), gate_px=np.array([1e6, 1e6])))


def history(ticks: int) -> dict[str, np.ndarray]:
    no = np.zeros(ticks, bool)
    return {"box_present": ~no, "box_accepted": ~no, "mode": np.zeros(ticks, np.int8)}


def test_stills_are_spread_over_the_run() -> None:
    assert camera_film.select_stills(history(111), 111) == list(range(0, 111, 10))
    assert camera_film.select_stills(history(111), 23) == list(range(0, 23, 2))
    assert camera_film.select_stills(history(3), 3) == [0, 1, 2]


def test_a_burn_and_a_refused_box_are_among_the_stills_however_short() -> None:
    run = history(111)
    run["mode"][52:55] = Mode.BURN
    run["box_accepted"][54:56] = False
    chosen = camera_film.select_stills(run, 111)
    assert len(chosen) == 12
    assert chosen == sorted(chosen)
    assert {0, 110, 53, 55} <= set(chosen)


def test_a_strip_has_rows_of_four() -> None:
    whole = camera_film.contact_sheet([shot()] * 6)
    assert whole.width == 4 * 384 + 3 * 8
    assert (
        np.asarray(whole)[: HEAD + 384, :384].tolist()
        == np.asarray(whole)[HEAD + 392 : 2 * (HEAD + 392) - 8, 392:776].tolist()
    )


@pytest.mark.parametrize("codec", camera_film.CODECS)
def test_a_film_has_every_picture(tmp_path: Path, codec: str) -> None:
    import cv2

    path = camera_film.write_film([shot(), shot(box_present=False), shot()], tmp_path / "seen.mp4", codec)
    capture = cv2.VideoCapture(str(path))
    found, picture = capture.read()
    assert found
    expected = camera_film.annotated_frame(*shot())
    assert picture.shape == expected.shape
    assert expected.shape[0] % 2 == expected.shape[1] % 2 == 0
    # Lossy, but red is red and blue is blue.
    assert np.abs(picture[..., ::-1].astype(float) - expected).mean() < 6.0
    assert [capture.read()[0] for _ in range(3)] == [True, True, False]
    assert list(tmp_path.iterdir()) == [path]


def test_a_film_for_browsers_is_in_h264_with_its_index_in_front_and_the_same_bytes_again(tmp_path: Path) -> None:
    one, two = (
        camera_film.write_film([shot(), shot()], tmp_path / name, "h264").read_bytes() for name in ("1.mp4", "2.mp4")
    )
    assert b"avc1" in one
    assert one.index(b"moov") < one.index(b"mdat")
    assert one == two


def test_a_codec_that_there_is_not_is_refused_before_any_picture_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OutputError, match=r"--codec: found 'av1', expected vp9 or h264"):
        camera_film.check_codec("av1")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    camera_film.check_codec("vp9")
    with pytest.raises(RpojaxError, match=r"imageio_ffmpeg: not installed, expected: pip install 'rpojax\[viz\]'"):
        camera_film.check_codec("h264")


def test_a_film_that_breaks_off_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "seen.mp4"
    path.write_text("mine")

    def broken() -> Any:
        yield shot()
        raise OutputError("no more")

    with pytest.raises(OutputError, match="no more"):
        camera_film.write_film(broken(), path)
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


def test_sheets_are_files_of_their_kind(tmp_path: Path) -> None:
    sheet = camera_film.contact_sheet([shot()])
    for name, content in (("PNG", camera_film.png_bytes(sheet)), ("JPEG", camera_film.jpeg_bytes(sheet))):
        (tmp_path / name).write_bytes(content)
        with Image.open(tmp_path / name) as image:
            assert (image.format, image.size) == (name, sheet.size)
