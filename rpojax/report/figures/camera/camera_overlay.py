"""Camera images annotated with the detector's box, the filter's gate and the state of the run."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.figures.colours import FILM_AMBER, FILM_BLUE, FILM_GREEN, FILM_GROUND, FILM_INK, FILM_MUTED

History = Mapping[str, np.ndarray]
CameraFrame = tuple[np.ndarray, History]
"""Image (p, p, 3), uint8 sRGB, and the recorded channels of its tick."""


@dataclass(frozen=True)
class TeamFrame:
    """Images of the cameras of a team at one tick, by the names of its servicers."""

    cameras: Mapping[str, CameraFrame]


Edges = tuple[float, float, float, float]
"""Left, top, right, bottom [px]."""
_GAP_PX = 4
"""Between the cameras of a team."""
_SIZE_PX = 384
"""Approximate side of enlarged images; those of 128 px are enlarged three times."""
_MODE_LABELS = {
    Mode.LOOK: "look",
    Mode.TURN: "turn",
    Mode.BURN: "burn",
    Mode.TURN_BACK: "turn back",
    Mode.SEARCH: "search",
}
_LEGEND = (
    ("box, accepted", FILM_GREEN, False),
    ("box, rejected", FILM_AMBER, False),
    ("expected on board, with its gate", FILM_BLUE, True),
)


def annotated_frame(frame: CameraFrame | TeamFrame) -> np.ndarray:
    """Frame of a film (h, w, 3), uint8 sRGB, with even width and height and a legend below the image."""
    return np.asarray(with_legend(annotated_image(frame)))


def annotated_image(frame: CameraFrame | TeamFrame) -> Image.Image:
    """Annotated image of a camera, or those of the cameras of a team side by side."""
    if not isinstance(frame, TeamFrame):
        return _annotated_camera(*frame)
    parts = [_annotated_camera(*camera, name) for name, camera in frame.cameras.items()]
    width, height = sum(part.width for part in parts) + _GAP_PX * (len(parts) - 1), max(part.height for part in parts)
    row, left = Image.new("RGB", (width, height), FILM_GROUND), 0
    for part in parts:
        row.paste(part, (left, 0))
        left += part.width + _GAP_PX
    return row


def _annotated_camera(image: np.ndarray, telemetry: History, name: str = "") -> Image.Image:
    """Image enlarged by a whole number, with box and gate, below two lines of text that begin with the name."""
    zoom = max(1, round(_SIZE_PX / image.shape[0]))
    large = Image.fromarray(image).resize((zoom * image.shape[1], zoom * image.shape[0]), Image.Resampling.NEAREST)
    scale = large.width / float(telemetry["window_px"][2])
    _draw_gate(large, telemetry, scale)
    _draw_box(large, telemetry, scale)
    font = _font(16)
    line = font.size * 1.35
    head = round(2.0 * line + 8.0)
    still = Image.new("RGB", (large.width, large.height + head), "black")
    still.paste(large, (0, head))
    draw = ImageDraw.Draw(still)
    mode = Mode(int(telemetry["mode"]))
    title = f"{name}:   " if name else ""
    light = "" if telemetry["observable"] else ", no usable light"
    draw.text(
        (6, 4),
        f"{title}{telemetry['time_s']:.0f} s   {telemetry['range_m']:.1f} m   {_MODE_LABELS[mode]}{light}",
        FILM_INK,
        font,
    )
    text, color = _box_status(telemetry)
    draw.text((6, 4 + line), text, color, font)
    return still


def with_legend(sheet: Image.Image) -> Image.Image:
    """Sheet with a legend below, padded to even width and height as video codecs require."""
    font, line = _font(13), 24.0
    positions, x, row = [], 8.0, 0
    for text, *_ in _LEGEND:
        width = 30 + font.getlength(text)
        if x > 8.0 and x + width > sheet.width:
            x, row = 8.0, row + 1
        positions.append((x, sheet.height + 5.0 + line * (row + 0.5)))
        x += width + 18
    height = sheet.height + round(line * (row + 1)) + 10
    ground = Image.new("RGB", (sheet.width + sheet.width % 2, height + height % 2), FILM_GROUND)
    ground.paste(sheet, (0, 0))
    draw = ImageDraw.Draw(ground)
    for (text, color, dashed), (x, middle) in zip(_LEGEND, positions, strict=True):
        if dashed:
            _draw_dashed_line(draw, (x, middle), (x + 24, middle))
        else:
            draw.line((x, middle, x + 24, middle), color, 3)
        draw.text((x + 30, middle), text, FILM_INK, font, anchor="lm")
    return ground


def _box_status(telemetry: History) -> tuple[str, str]:
    """Text and colour for the detector's box of a tick."""
    score = f"{float(telemetry['box_score']):.2f}"
    if not telemetry["box_present"]:
        return f"no box, best score {score}", FILM_MUTED
    cut = ", cut by the frame" if telemetry["box_truncated"] else ""
    if telemetry["box_accepted"]:
        return f"box accepted, score {score}{cut}", FILM_GREEN
    return f"box rejected, score {score}{cut}", FILM_AMBER


def _draw_box(image: Image.Image, telemetry: History, scale: float) -> None:
    if not telemetry["box_present"]:
        return
    left, top, width, height = (float(value) for value in telemetry["box_px"])
    color = FILM_GREEN if telemetry["box_accepted"] else FILM_AMBER
    edges = _to_image_pixels((left, top, left + width, top + height), telemetry, scale)
    ImageDraw.Draw(image).rectangle(_sorted_edges(edges), outline=color, width=2)


def _draw_gate(image: Image.Image, telemetry: History, scale: float) -> None:
    """Draws a cross at the predicted box centre and a dashed line around the gate in which it is accepted."""
    x, y, _ = (float(value) for value in telemetry["expected_px"])
    across, down = (float(value) for value in telemetry["gate_px"])
    if not np.isfinite([x, y, across, down]).all():
        return
    left, top, right, bottom = _to_image_pixels((x - across, y - down, x + across, y + down), telemetry, scale)
    draw = ImageDraw.Draw(image)
    for start, stop in (((left, top), (right, top)), ((left, bottom), (right, bottom))):
        _draw_dashed_line(draw, start, stop)
    for start, stop in (((left, top), (left, bottom)), ((right, top), (right, bottom))):
        _draw_dashed_line(draw, start, stop)
    middle_x, middle_y = 0.5 * (left + right), 0.5 * (top + bottom)
    draw.line((middle_x - 6, middle_y, middle_x + 6, middle_y), FILM_BLUE, 2)
    draw.line((middle_x, middle_y - 6, middle_x, middle_y + 6), FILM_BLUE, 2)


def _draw_dashed_line(draw: ImageDraw.ImageDraw, start: tuple[float, float], stop: tuple[float, float]) -> None:
    """Draws a dashed line, clipped near the image: a gate may be many times larger."""
    (x0, y0), (x1, y1) = (tuple(min(max(value, -8.0), 2048.0) for value in point) for point in (start, stop))
    length = max(abs(x1 - x0), abs(y1 - y0))
    for begin in np.arange(0.0, length, 9.0):
        a, b = begin / length, min(begin + 5.0, length) / length
        draw.line((x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0)), FILM_BLUE, 1)


def _to_image_pixels(edges: Edges, telemetry: History, scale: float) -> Edges:
    """Edges in pixels of the enlarged image, from pixels of the camera's frame."""
    left, top = (float(value) for value in telemetry["window_px"][:2])
    return (
        (edges[0] - left) * scale,
        (edges[1] - top) * scale,
        (edges[2] - left) * scale,
        (edges[3] - top) * scale,
    )


def _sorted_edges(edges: Edges) -> Edges:
    """Edges in increasing order: a box of the detector may have a negative width or height."""
    return min(edges[0], edges[2]), min(edges[1], edges[3]), max(edges[0], edges[2]), max(edges[1], edges[3])


@lru_cache(maxsize=8)
def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
