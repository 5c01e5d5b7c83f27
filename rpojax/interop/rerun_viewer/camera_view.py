"""Camera view of a recording: images of a rendered camera, detected, expected and true boxes."""

import io
from collections.abc import Iterable, Iterator

import numpy as np
import rerun as rr
from PIL import Image

from rpojax.interop.rerun_viewer.rrd_chunks import RrdChunks, ServicerChunks
from rpojax.interop.rerun_viewer.scene_3d import ACCEPTED_COLOR, CAMERA, TRUE_COLOR
from rpojax.interop.rerun_viewer.viewer_channels import ViewerChannels
from rpojax.interop.run_replay import PosedImage, ReplayedRun

_REJECTED_COLOR = (255, 138, 51)
_TRUE_OUTLINE_COLOR = (130, 138, 150)
_EMPTY_COLOR = (18, 20, 26)
_IMAGES_PER_CHUNK = 100
"""Encoded images in memory at once."""


def add_camera_view(
    chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels], images: Iterable[PosedImage] | None
) -> int:
    """Adds the boxes of every tick and the images of a rendered camera; returns the number of images."""
    size = (run.servicer_file.camera.width_px, run.servicer_file.camera.height_px)
    _add_boxes(chunks, run)
    if images is None:
        chunks.add_static(f"{CAMERA}/frame", _encoded_png(Image.new("RGB", size, _EMPTY_COLOR)))
        return 0
    count = 0
    for times, blobs in _encoded_batches(images, size):
        count += len(times)
        columns = rr.EncodedImage.columns(blob=blobs, media_type=["image/jpeg"] * len(blobs))
        chunks.add(f"{CAMERA}/picture", np.array(times), columns)
    return count


def window_in_frame(image: np.ndarray, window_px: np.ndarray, size: tuple[int, int]) -> Image.Image:
    """Frame (width, height), empty except for the image of a square window (left, top, side) [px]."""
    left, top, side = (float(value) for value in window_px)
    frame = Image.new("RGB", size, _EMPTY_COLOR)
    scaled = Image.fromarray(image).resize((round(side), round(side)), Image.Resampling.BOX)
    frame.paste(scaled, (round(left), round(top)))
    return frame


def _encoded_batches(images: Iterable[PosedImage], size: tuple[int, int]) -> Iterator[tuple[list[float], list[bytes]]]:
    times: list[float] = []
    blobs: list[bytes] = []
    for image, seen in images:
        buffer = io.BytesIO()
        window_in_frame(image, seen["window_px"], size).save(buffer, format="JPEG", quality=90, subsampling=0)
        times.append(float(seen["time_s"]))
        blobs.append(buffer.getvalue())
        if len(blobs) == _IMAGES_PER_CHUNK:
            yield times, blobs
            times, blobs = [], []
    if blobs:
        yield times, blobs


def _encoded_png(image: Image.Image) -> rr.EncodedImage:
    buffer = io.BytesIO()
    image.save(buffer, format="PNG")
    return rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png")


def _add_boxes(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    channels = run.values
    present, accepted = channels["box_present"], channels["box_accepted"]
    color = np.where(accepted[:, None], ACCEPTED_COLOR, _REJECTED_COLOR).astype(np.uint8)[present]
    _add_box(chunks, run, "detected", present, *_centers_and_half_sizes(channels["box_px"]), color)
    outline = channels["outline_px"]
    visible = outline[:, 2:].min(axis=1) > 0.0
    _add_box(
        chunks,
        run,
        "true_outline",
        visible,
        *_centers_and_half_sizes(outline),
        np.array(_TRUE_OUTLINE_COLOR, dtype=np.uint8),
    )
    gate, center = channels["gate_px"], channels["expected_px"][:, :2]
    expected = np.isfinite(gate.sum(axis=1) + center.sum(axis=1))
    _add_box(chunks, run, "expected", expected, center, gate, np.array(TRUE_COLOR, dtype=np.uint8))


def _centers_and_half_sizes(boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centers and half sides of boxes (left, top, width, height)."""
    half = 0.5 * boxes[:, 2:]
    return boxes[:, :2] + half, half


def _add_box(
    chunks: RrdChunks | ServicerChunks,
    run: ReplayedRun[ViewerChannels],
    name: str,
    present: np.ndarray,
    center: np.ndarray,
    half_size: np.ndarray,
    color: np.ndarray,
) -> None:
    """Adds a box in the ticks where it is present."""
    count = int(present.sum())
    colors = np.broadcast_to(color, (count, 3))
    columns = rr.Boxes2D.columns(centers=center[present], half_sizes=half_size[present], colors=colors)
    chunks.add(f"{CAMERA}/{name}", run.time_s, columns.partition(present.astype(int)))
