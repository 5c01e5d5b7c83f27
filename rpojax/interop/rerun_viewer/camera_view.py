"""What the camera of a run saw: its pictures, if it takes some, the boxes, and where the box was expected."""

import io
from collections.abc import Iterable, Iterator

import numpy as np
import rerun as rr
from PIL import Image

from rpojax.interop.rerun_viewer.data_columns import Chunks
from rpojax.interop.rerun_viewer.scene_3d import CAMERA, GREEN, TRUE
from rpojax.interop.rerun_viewer.viewer_values import Shown
from rpojax.interop.run_replay import Flight, Shot

_AMBER = (255, 138, 51)
_GREY = (130, 138, 150)
_EMPTY = (18, 20, 26)
_AT_ONCE = 100
"""Pictures in memory."""


def add(chunks: Chunks, flight: Flight[Shown], shots: Iterable[Shot] | None) -> int:
    """Adds boxes of every tick and, one by one, pictures with their channels; returns the number of pictures."""
    size = (flight.file.camera.width_px, flight.file.camera.height_px)
    _add_boxes(chunks, flight)
    if shots is None:
        chunks.add_static(f"{CAMERA}/frame", _encoded(Image.new("RGB", size, _EMPTY)))
        return 0
    count = 0
    for times, blobs in _batches(shots, size):
        count += len(times)
        columns = rr.EncodedImage.columns(blob=blobs, media_type=["image/jpeg"] * len(blobs))
        chunks.add(f"{CAMERA}/picture", np.array(times), columns)
    return count


def in_frame(picture: np.ndarray, window_px: np.ndarray, size: tuple[int, int]) -> Image.Image:
    """A picture of a square window (left, top, side) [px] where it belongs in an else empty frame (width, height)."""
    left, top, side = (float(value) for value in window_px)
    frame = Image.new("RGB", size, _EMPTY)
    scaled = Image.fromarray(picture).resize((round(side), round(side)), Image.Resampling.BOX)
    frame.paste(scaled, (round(left), round(top)))
    return frame


def _batches(shots: Iterable[Shot], size: tuple[int, int]) -> Iterator[tuple[list[float], list[bytes]]]:
    times: list[float] = []
    blobs: list[bytes] = []
    for picture, seen in shots:
        buffer = io.BytesIO()
        in_frame(picture, seen["window_px"], size).save(buffer, format="JPEG", quality=90, subsampling=0)
        times.append(float(seen["time_s"]))
        blobs.append(buffer.getvalue())
        if len(blobs) == _AT_ONCE:
            yield times, blobs
            times, blobs = [], []
    if blobs:
        yield times, blobs


def _encoded(image: Image.Image) -> rr.EncodedImage:
    buffer = io.BytesIO()
    image.save(buffer, format="PNG")
    return rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png")


def _add_boxes(chunks: Chunks, flight: Flight[Shown]) -> None:
    seen = flight.values
    present, accepted = seen["box_present"], seen["box_accepted"]
    color = np.where(accepted[:, None], GREEN, _AMBER).astype(np.uint8)[present]
    _add(chunks, flight, "detected", present, *_middles(seen["box_px"]), color)
    outline = seen["outline_px"]
    visible = outline[:, 2:].min(axis=1) > 0.0
    _add(chunks, flight, "true_outline", visible, *_middles(outline), np.array(_GREY, dtype=np.uint8))
    gate, middle = seen["gate_px"], seen["expected_px"][:, :2]
    expected = np.isfinite(gate.sum(axis=1) + middle.sum(axis=1))
    _add(chunks, flight, "expected", expected, middle, gate, np.array(TRUE, dtype=np.uint8))


def _middles(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles and half sides of boxes given by left, top, width and height."""
    half = 0.5 * corners[:, 2:]
    return corners[:, :2] + half, half


def _add(
    chunks: Chunks,
    flight: Flight[Shown],
    name: str,
    there: np.ndarray,
    middle: np.ndarray,
    half: np.ndarray,
    color: np.ndarray,
) -> None:
    """A box in the ticks in which it is there, none in the others."""
    count = int(there.sum())
    colors = np.broadcast_to(color, (count, 3))
    columns = rr.Boxes2D.columns(centers=middle[there], half_sizes=half[there], colors=colors)
    chunks.add(f"{CAMERA}/{name}", flight.time_s, columns.partition(there.astype(int)))
