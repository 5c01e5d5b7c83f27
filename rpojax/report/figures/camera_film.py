"""What a camera saw, drawn for people: enlarged pictures with the detector's box and what flight software expected."""

import io
import os
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rpojax.errors import OutputError
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.optional import require_package
from rpojax.report.figures.colours import FILM_AMBER, FILM_BLUE, FILM_GREEN, FILM_GROUND, FILM_INK, FILM_MUTED

History = Mapping[str, np.ndarray]
CameraFrame = tuple[np.ndarray, History]
Edges = tuple[float, float, float, float]

_MAX_STILLS = 12
_COLUMNS = 4
_SIZE_PX = 384
"""About so large pictures become: three times for those of 128 px."""
_GAP_PX = 8
_FRAMES_PER_S = 12.0
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


def select_stills(history: History, ticks: int) -> list[int]:
    """Up to twelve of the first `ticks` ticks, spread evenly, one of a burn and one of a refused box among them."""
    chosen = np.unique(np.linspace(0, ticks - 1, min(_MAX_STILLS, ticks)).round().astype(int)).tolist()
    kept = {chosen[0], chosen[-1]}
    refused = history["box_present"] & ~history["box_accepted"]
    for wanted in (history["mode"] == Mode.BURN, refused):
        found = np.flatnonzero(wanted[:ticks]).tolist()
        there = [tick for tick in chosen if wanted[tick]]
        free = [tick for tick in chosen if tick not in kept]
        if found and not there and free:
            there = [found[len(found) // 2]]
            chosen.remove(min(free, key=lambda tick: abs(tick - there[0])))
            chosen.append(there[0])
        kept.update(there[:1])
    return sorted(chosen)


def annotated_frame(image: np.ndarray, telemetry: History) -> np.ndarray:
    """A picture of a film (h, w, 3), uint8 sRGB, even numbers of pixels a side, with a legend below."""
    return np.asarray(_with_legend(_annotated_image(image, telemetry)))


def contact_sheet(frames: Iterable[CameraFrame]) -> Image.Image:
    """Pictures as one sheet, row by row, with a legend below."""
    tiles = [_annotated_image(picture, seen) for picture, seen in frames]
    columns = min(_COLUMNS, len(tiles))
    rows = -(-len(tiles) // columns)
    width, height = tiles[0].width + _GAP_PX, tiles[0].height + _GAP_PX
    sheet = Image.new("RGB", (columns * width - _GAP_PX, rows * height - _GAP_PX), FILM_GROUND)
    for index, tile in enumerate(tiles):
        sheet.paste(tile, (index % columns * width, index // columns * height))
    return _with_legend(sheet)


def write_film(frames: Iterable[CameraFrame], path: Path, codec: str = "vp9") -> Path:
    """Writes pictures as a film in MP4, 12 a second, by one of `CODECS`; returns `path`.

    Raises:
        OutputError: there cannot be such a file.
        MissingExtraError: H.264 needs a package that is not installed.
    """
    encode = _ENCODERS[codec]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.mp4")
        try:
            encode((annotated_frame(picture, seen) for picture, seen in frames), partial, path)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: found {error.strerror or error}, expected a file that can be written") from None
    return path


def check_codec(codec: str) -> None:
    """Raises an error where films cannot be written by `codec`, before any picture is taken for one."""
    if codec not in CODECS:
        raise OutputError(f"--codec: found {codec!r}, expected {' or '.join(CODECS)}")
    if codec == "h264":
        require_package("imageio_ffmpeg", "viz")


def _encode_vp9(frames: Iterable[np.ndarray], partial: Path, path: Path) -> None:
    import cv2

    writer = None
    try:
        for drawn in frames:
            if writer is None:
                code = cv2.VideoWriter.fourcc(*"vp09")
                writer = cv2.VideoWriter(str(partial), code, _FRAMES_PER_S, (drawn.shape[1], drawn.shape[0]))
                if not writer.isOpened():
                    raise OutputError(f"{path}: found no way to write a film there, expected a writable place")
            writer.write(np.ascontiguousarray(drawn[..., ::-1]))
    finally:
        if writer is not None:
            writer.release()


def _encode_h264(frames: Iterable[np.ndarray], partial: Path, path: Path) -> None:
    """As players and browsers like it: 4:2:0, its index in front; one thread and no dates, for the same bytes again."""
    write_frames = require_package("imageio_ffmpeg", "viz").write_frames
    options = ["-crf", "20", "-threads", "1", "-movflags", "+faststart", "-map_metadata", "-1", "-fflags", "+bitexact"]
    writer = None
    try:
        for drawn in frames:
            if writer is None:
                partial.touch()
                size = (drawn.shape[1], drawn.shape[0])
                writer = write_frames(
                    str(partial),
                    size,
                    fps=_FRAMES_PER_S,
                    codec="libx264",
                    pix_fmt_out="yuv420p",
                    quality=None,
                    macro_block_size=2,
                    output_params=[*options, "-flags:v", "+bitexact"],
                )
                writer.send(None)
            writer.send(np.ascontiguousarray(drawn))
    finally:
        if writer is not None:
            writer.close()


_ENCODERS: dict[str, Callable[[Iterable[np.ndarray], Path, Path], None]] = {"vp9": _encode_vp9, "h264": _encode_h264}
CODECS = tuple(_ENCODERS)
"""Codecs of films: VP9, which needs nothing more, and H.264, which plays everywhere."""


def png_bytes(sheet: Image.Image) -> bytes:
    """A sheet as a PNG file."""
    buffer = io.BytesIO()
    sheet.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def jpeg_bytes(sheet: Image.Image) -> bytes:
    """A sheet as a JPEG file, a few hundred kilobytes."""
    buffer = io.BytesIO()
    sheet.save(buffer, format="JPEG", quality=85, subsampling=0, optimize=True)
    return buffer.getvalue()


def _annotated_image(image: np.ndarray, telemetry: History) -> Image.Image:
    """One picture, enlarged by a whole number, under two lines of text."""
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
    light = "" if telemetry["observable"] else ", no usable light"
    draw.text(
        (6, 4),
        f"{telemetry['time_s']:.0f} s   {telemetry['range_m']:.1f} m   {_MODE_LABELS[mode]}{light}",
        FILM_INK,
        font,
    )
    text, color = _box_status(telemetry)
    draw.text((6, 4 + line), text, color, font)
    return still


def _box_status(telemetry: History) -> tuple[str, str]:
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
    """A cross where the box centre was expected, and a dashed line around where it would have been accepted."""
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
    """Dashed line, only where a picture can be: a gate may be as wide as the sky."""
    (x0, y0), (x1, y1) = (tuple(min(max(value, -8.0), 2048.0) for value in point) for point in (start, stop))
    length = max(abs(x1 - x0), abs(y1 - y0))
    for begin in np.arange(0.0, length, 9.0):
        a, b = begin / length, min(begin + 5.0, length) / length
        draw.line((x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0)), FILM_BLUE, 1)


def _to_image_pixels(edges: Edges, telemetry: History, scale: float) -> Edges:
    """Edges in pixels of the enlarged picture."""
    left, top = (float(value) for value in telemetry["window_px"][:2])
    return (
        (edges[0] - left) * scale,
        (edges[1] - top) * scale,
        (edges[2] - left) * scale,
        (edges[3] - top) * scale,
    )


def _sorted_edges(edges: Edges) -> Edges:
    """A detector may name a right edge left of the left one."""
    return min(edges[0], edges[2]), min(edges[1], edges[3]), max(edges[0], edges[2]), max(edges[1], edges[3])


def _with_legend(sheet: Image.Image) -> Image.Image:
    """The sheet on a ground of even numbers of pixels a side, as films need them, with a legend below."""
    font, line = _font(13), 24.0
    places, x, row = [], 8.0, 0
    for text, *_ in _LEGEND:
        width = 30 + font.getlength(text)
        if x > 8.0 and x + width > sheet.width:
            x, row = 8.0, row + 1
        places.append((x, sheet.height + 5.0 + line * (row + 0.5)))
        x += width + 18
    height = sheet.height + round(line * (row + 1)) + 10
    ground = Image.new("RGB", (sheet.width + sheet.width % 2, height + height % 2), FILM_GROUND)
    ground.paste(sheet, (0, 0))
    draw = ImageDraw.Draw(ground)
    for (text, color, dashed), (x, middle) in zip(_LEGEND, places, strict=True):
        if dashed:
            _draw_dashed_line(draw, (x, middle), (x + 24, middle))
        else:
            draw.line((x, middle, x + 24, middle), color, 3)
        draw.text((x + 30, middle), text, FILM_INK, font, anchor="lm")
    return ground


@lru_cache(maxsize=8)
def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
