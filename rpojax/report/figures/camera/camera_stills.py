"""Contact sheet of annotated camera images at selected ticks of a run."""

import io
from collections.abc import Iterable

import numpy as np
from PIL import Image

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.figures.camera.camera_overlay import (
    CameraFrame,
    History,
    TeamFrame,
    annotated_image,
    with_legend,
)
from rpojax.report.figures.colours import FILM_GROUND

_MAX_STILLS = 12
_COLUMNS = 4
_GAP_PX = 8


def select_stills(history: History, ticks: int) -> list[int]:
    """Up to twelve of the first `ticks` ticks, spread evenly, including one of a burn and one with a rejected box."""
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
    """Annotated images in rows of four, those of a team's tick in one row, with a legend below."""
    shown = list(frames)
    tiles = [annotated_image(frame) for frame in shown]
    cameras = max(len(frame.cameras) if isinstance(frame, TeamFrame) else 1 for frame in shown)
    columns = min(max(1, _COLUMNS // cameras), len(tiles))
    rows = -(-len(tiles) // columns)
    width, height = tiles[0].width + _GAP_PX, tiles[0].height + _GAP_PX
    sheet = Image.new("RGB", (columns * width - _GAP_PX, rows * height - _GAP_PX), FILM_GROUND)
    for index, tile in enumerate(tiles):
        sheet.paste(tile, (index % columns * width, index // columns * height))
    return with_legend(sheet)


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
