"""A run as a recording for the rerun viewer: scene, camera and plots on one time line of simulation time."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rpojax.errors import OutputError
from rpojax.interop.rerun_viewer.viewer_values import Shown
from rpojax.interop.run_replay import Flight, Shot
from rpojax.optional import need
from rpojax.scenario import scenario_file

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
    from rpojax.interop.rerun_viewer.data_columns import strictly

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
    from rpojax.interop.rerun_viewer import camera_view, scene_3d, time_plots, viewer_layout
    from rpojax.interop.rerun_viewer.data_columns import Chunks, recorded

    chunks = Chunks()
    chunks.add_name(f"{flight.file.name}, seed {flight.seed}, run {flight.run_id}")
    chunks.add_static(viewer_layout.ABOUT, viewer_layout.about(flight))
    plots = time_plots.plots(flight)
    scene_3d.add(chunks, flight)
    time_plots.add(chunks, flight, plots)
    pictures = camera_view.add(chunks, flight, shots)
    recorded(chunks, path, APPLICATION, identity(flight), viewer_layout.blueprint(flight, plots))
    return pictures


def identity(flight: Flight[Shown]) -> str:
    """Name of a recording, the same for the same run of the same scenario."""
    return f"{scenario_file.digest(flight.file)[:16]}-seed{flight.seed}-run{flight.run_id}"
