"""Synthetic camera image with a box and a gate, and position of a colour in its annotated image."""

from typing import Any

import numpy as np

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.figures import camera_pictures

IMAGE_SIDE = 128
TEXT_HEIGHT = 51
"""Height of the text above an image [px]."""


def camera_frame(**changes: Any) -> camera_pictures.CameraFrame:
    """Black image of the middle of a frame of 512 px, binned by two, and the channels of its tick."""
    telemetry = {
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
    return np.zeros((IMAGE_SIDE, IMAGE_SIDE, 3), np.uint8), {
        name: np.asarray(value) for name, value in (telemetry | changes).items()
    }


def area_of(color: str, sheet: np.ndarray) -> tuple[int, ...] | None:
    """Left, top, right and bottom pixel of a colour in the annotated image, without text and legend."""
    rgb = [int(color[place : place + 2], 16) for place in (1, 3, 5)]
    rows, columns = np.nonzero((sheet[TEXT_HEIGHT : TEXT_HEIGHT + 3 * IMAGE_SIDE] == rgb).all(axis=2))
    if len(rows) == 0:
        return None
    return tuple(int(value) for value in (columns.min(), rows.min(), columns.max(), rows.max()))
