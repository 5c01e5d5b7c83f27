"""Annotated camera images, contact sheets and films of one run."""

import io
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.errors import OutputError, RpojaxError
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.optional_packages import require_package
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.brightened_images import developed
from rpojax.report.figures.colours import FILM_AMBER, FILM_BLUE, FILM_GREEN, FILM_GROUND, FILM_INK, FILM_MUTED

History = Mapping[str, np.ndarray]
CameraFrame = tuple[np.ndarray, History]
"""Image (p, p, 3), uint8 sRGB, and the recorded channels of its tick."""
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
_MAX_STILLS = 12
_COLUMNS = 4
_SHEET_GAP_PX = 8
_FRAMES_PER_S = 12.0


@dataclass(frozen=True)
class TeamFrame:
    """Images of the cameras of a team at one tick, by the names of its servicers."""

    cameras: Mapping[str, CameraFrame]


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


def select_stills(history: History, ticks: int) -> list[int]:
    """Up to twelve of the first `ticks` ticks, spread evenly, with a burn and a rejected box among them."""
    chosen = np.unique(np.linspace(0, ticks - 1, min(_MAX_STILLS, ticks)).round().astype(int)).tolist()
    kept = {chosen[0], chosen[-1]}
    rejected = history["box_present"] & ~history["box_accepted"]
    for wanted in (history["mode"] == Mode.BURN, rejected):
        candidates = np.flatnonzero(wanted[:ticks]).tolist()
        included = [tick for tick in chosen if wanted[tick]]
        replaceable = [tick for tick in chosen if tick not in kept]
        if candidates and not included and replaceable:
            included = [candidates[len(candidates) // 2]]
            chosen.remove(min(replaceable, key=lambda tick: abs(tick - included[0])))
            chosen.append(included[0])
        kept.update(included[:1])
    return sorted(chosen)


def contact_sheet(frames: Iterable[CameraFrame | TeamFrame]) -> Image.Image:
    """Annotated images in rows of four, or a row for each tick of a team, with a legend below; dark ones brightened."""
    shown = [_developed(frame) for frame in frames]
    tiles = [annotated_image(frame) for frame in shown]
    cameras = max(len(frame.cameras) if isinstance(frame, TeamFrame) else 1 for frame in shown)
    columns = min(max(1, _COLUMNS // cameras), len(tiles))
    rows = -(-len(tiles) // columns)
    width, height = tiles[0].width + _SHEET_GAP_PX, tiles[0].height + _SHEET_GAP_PX
    sheet = Image.new("RGB", (columns * width - _SHEET_GAP_PX, rows * height - _SHEET_GAP_PX), FILM_GROUND)
    for index, tile in enumerate(tiles):
        sheet.paste(tile, (index % columns * width, index // columns * height))
    return with_legend(sheet)


def _developed(frame: CameraFrame | TeamFrame) -> CameraFrame | TeamFrame:
    if isinstance(frame, TeamFrame):
        return TeamFrame({name: (developed(image), telemetry) for name, (image, telemetry) in frame.cameras.items()})
    return developed(frame[0]), frame[1]


def png_bytes(sheet: Image.Image) -> bytes:
    """Contact sheet as the bytes of a PNG file."""
    buffer = io.BytesIO()
    sheet.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def jpeg_bytes(sheet: Image.Image) -> bytes:
    """Contact sheet as the bytes of a JPEG file of a few hundred kilobytes."""
    buffer = io.BytesIO()
    sheet.save(buffer, format="JPEG", quality=85, subsampling=0, optimize=True)
    return buffer.getvalue()


@dataclass(frozen=True)
class CameraSheet:
    """File of a contact sheet, or the reason why there is none."""

    path: Path | None
    reason: str = ""


def write_camera_sheet(campaign: CampaignResults, run_id: int | None) -> CameraSheet:
    """Renders camera images of a run again and writes them as figures/camera.jpg in the campaign's folder.

    Of a team they are those of its first servicer.
    """
    if run_id is None:
        return CameraSheet(None, "No full history was kept.")
    # Imported here because rendering imports the simulation.
    from rpojax.campaign import rerender
    from rpojax.campaign.options.campaign_options import CampaignOptions

    if campaign.info["scenario"].get("camera", {}).get("model") != "rendered":
        return CameraSheet(None, "The scenario's camera renders no images.")
    try:
        file = rerender.rendered_scenario(campaign.info["scenario"], campaign.info["scenario_hash"])
        history = campaign.history(run_id, 0)
        if not rerender.is_renderable(history, file):
            return CameraSheet(None, "The history of this run was not kept in full.")
        ticks = select_stills(history, rerender.valid_tick_count(history))
        options = CampaignOptions.from_record(campaign.info)
        sheet = contact_sheet(
            rerender.render_images(
                file, options.seed, run_id, history, ticks, options.design_range, 0 if campaign.servicer_names else None
            )
        )
    except RpojaxError as error:
        return CameraSheet(None, f"The images cannot be rendered again: {error}.")
    return CameraSheet(write_atomically(campaign.directory / "figures" / "camera.jpg", jpeg_bytes(sheet)))


def write_film(frames: Iterable[CameraFrame | TeamFrame], path: Path, codec: str = "vp9") -> Path:
    """Writes images as an MP4 film at 12 frames per second with one of `CODECS`; returns `path`.

    Raises:
        OutputError: the file cannot be written.
        MissingExtraError: the package that encodes H.264 is not installed.
    """
    encode = _ENCODERS[codec]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.mp4")
        try:
            encode((annotated_frame(frame) for frame in frames), partial, path)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: found {error.strerror or error}, expected a file that can be written") from None
    return path


def check_codec(codec: str) -> None:
    """Raises an error if films cannot be encoded with `codec`; called before any image is rendered.

    Raises:
        OutputError: the codec is unknown.
        MissingExtraError: the package that encodes H.264 is not installed.
    """
    if codec not in CODECS:
        raise OutputError.of_argument("codec", f"found {codec!r}, expected {' or '.join(CODECS)}")
    if codec == "h264":
        require_package("imageio_ffmpeg")


def _encode_vp9(frames: Iterable[np.ndarray], partial: Path, path: Path) -> None:
    import cv2

    writer = None
    try:
        for frame in frames:
            if writer is None:
                code = cv2.VideoWriter.fourcc(*"vp09")
                writer = cv2.VideoWriter(str(partial), code, _FRAMES_PER_S, (frame.shape[1], frame.shape[0]))
                if not writer.isOpened():
                    raise OutputError(f"{path}: found no way to write a film there, expected a writable place")
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
    finally:
        if writer is not None:
            writer.release()


def _encode_h264(frames: Iterable[np.ndarray], partial: Path, path: Path) -> None:
    """4:2:0 with the index in front for browsers; one thread and no dates for reproducible bytes."""
    write_frames = require_package("imageio_ffmpeg").write_frames
    options = ["-crf", "20", "-threads", "1", "-movflags", "+faststart", "-map_metadata", "-1", "-fflags", "+bitexact"]
    writer = None
    try:
        for frame in frames:
            if writer is None:
                partial.touch()
                size = (frame.shape[1], frame.shape[0])
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
            writer.send(np.ascontiguousarray(frame))
    finally:
        if writer is not None:
            writer.close()


_ENCODERS: dict[str, Callable[[Iterable[np.ndarray], Path, Path], None]] = {"vp9": _encode_vp9, "h264": _encode_h264}
CODECS = tuple(_ENCODERS)
"""Codecs of films: VP9 needs no extra package, H.264 plays in every browser."""
