"""Films of annotated camera images: encoders and the MP4 file."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from rpojax.errors import OutputError
from rpojax.optional_packages import require_package
from rpojax.report.figures.camera.camera_overlay import CameraFrame, TeamFrame, annotated_frame

_FRAMES_PER_S = 12.0


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
