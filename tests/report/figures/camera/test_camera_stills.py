"""Selected stills and their contact sheet."""

from pathlib import Path

import numpy as np
from PIL import Image
from synthetic_camera_frames import TEXT_HEIGHT, camera_frame

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.figures import camera_pictures


def history(ticks: int) -> dict[str, np.ndarray]:
    no = np.zeros(ticks, bool)
    return {"box_present": ~no, "box_accepted": ~no, "mode": np.zeros(ticks, np.int8)}


def test_stills_are_spread_evenly() -> None:
    assert camera_pictures.select_stills(history(111), 111) == list(range(0, 111, 10))
    assert camera_pictures.select_stills(history(111), 23) == list(range(0, 23, 2))
    assert camera_pictures.select_stills(history(3), 3) == [0, 1, 2]


def test_stills_include_a_burn_and_a_rejected_box() -> None:
    run = history(111)
    run["mode"][52:55] = Mode.BURN
    run["box_accepted"][54:56] = False
    chosen = camera_pictures.select_stills(run, 111)
    assert len(chosen) == 12
    assert chosen == sorted(chosen)
    assert {0, 110, 53, 55} <= set(chosen)


def test_contact_sheet_has_rows_of_four() -> None:
    whole = camera_pictures.contact_sheet([camera_frame()] * 6)
    assert whole.width == 4 * 384 + 3 * 8
    assert (
        np.asarray(whole)[: TEXT_HEIGHT + 384, :384].tolist()
        == np.asarray(whole)[TEXT_HEIGHT + 392 : 2 * (TEXT_HEIGHT + 392) - 8, 392:776].tolist()
    )


def test_sheets_are_png_and_jpeg_files(tmp_path: Path) -> None:
    sheet = camera_pictures.contact_sheet([camera_frame()])
    for name, content in (("PNG", camera_pictures.png_bytes(sheet)), ("JPEG", camera_pictures.jpeg_bytes(sheet))):
        (tmp_path / name).write_bytes(content)
        with Image.open(tmp_path / name) as image:
            assert (image.format, image.size) == (name, sheet.size)
