"""A run as a recording for the rerun viewer: scene, camera and plots on one time line of simulation time."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rpojax.errors import OutputError
from rpojax.interop.flight_record import Flight, Shot
from rpojax.interop.shown_values import Shown
from rpojax.simulation import scenario
from rpojax.training.optional import need

APPLICATION = "rpojax"


@dataclass(frozen=True)
class Recording:
    """What was written.

    Attributes:
        path: of the file
        ticks: of the run
        pictures: of the camera
        size_bytes: of the file
    """

    path: Path
    ticks: int
    pictures: int
    size_bytes: int


def check() -> None:
    """Raises `MissingExtraError` where the viewer's package is not installed."""
    need("rerun", "viz")


def write(flight: Flight[Shown], path: Path, shots: Iterable[Shot] | None = None) -> Recording:
    """Writes a run, with pictures and their channels for a camera that takes some, and the arrangement of its views.

    Raises:
        MissingExtraError: the viewer's package is not installed.
        OutputError: there cannot be such a file.
    """
    check()
    from rpojax.interop.rerun_chunks import strictly

    partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.rrd")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with strictly():
                pictures = _record(flight, partial, shots)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: found {error.strerror or error}, expected a file that can be written") from None
    return Recording(path, flight.ticks, pictures, path.stat().st_size)


def _record(flight: Flight[Shown], path: Path, shots: Iterable[Shot] | None) -> int:
    """Writes all of it; returns the number of pictures."""
    from rpojax.interop import rerun_camera, rerun_layout, rerun_plots, rerun_scene
    from rpojax.interop.rerun_chunks import Chunks, recorded

    chunks = Chunks()
    chunks.add_name(f"{flight.file.name}, seed {flight.seed}, run {flight.run_id}")
    chunks.add_static(rerun_layout.ABOUT, rerun_layout.about(flight))
    plots = rerun_plots.plots(flight)
    rerun_scene.add(chunks, flight)
    rerun_plots.add(chunks, flight, plots)
    pictures = rerun_camera.add(chunks, flight, shots)
    recorded(chunks, path, APPLICATION, identity(flight), rerun_layout.blueprint(flight, plots))
    return pictures


def identity(flight: Flight[Shown]) -> str:
    """Name of a recording, the same for the same run of the same scenario."""
    return f"{scenario.digest(flight.file)[:16]}-seed{flight.seed}-run{flight.run_id}"
