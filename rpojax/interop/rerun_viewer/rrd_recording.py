"""Recording of a run for the rerun viewer: scene, camera and plots over simulation time."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rpojax.errors import OutputError
from rpojax.interop.rerun_viewer.viewer_channels import ViewerChannels
from rpojax.interop.run_replay import PosedImage, ReplayedRun
from rpojax.optional_packages import require_package
from rpojax.scenario.scenario_digest import scenario_digest

APPLICATION = "rpojax"


@dataclass(frozen=True)
class WrittenRecording:
    """Description of a written recording.

    Attributes:
        path: of the file
        ticks: number of ticks of the run
        images: number of images of the camera
        size_bytes: of the file
    """

    path: Path
    ticks: int
    images: int
    size_bytes: int


def require_rerun() -> None:
    """Raises `MissingExtraError` where rerun is not installed."""
    require_package("rerun")


def write_recording(
    run: ReplayedRun[ViewerChannels], path: Path, images: Iterable[PosedImage] | None = None
) -> WrittenRecording:
    """Writes a run, the images of a rendered camera, and the blueprint of its views.

    Raises:
        MissingExtraError: rerun is not installed.
        OutputError: the file cannot be written.
    """
    return write_servicers([run], path, [images])


def write_servicers(
    runs: Sequence[ReplayedRun[ViewerChannels]], path: Path, images: Sequence[Iterable[PosedImage] | None]
) -> WrittenRecording:
    """Writes a run of a team, or of one servicer, with the images of each rendered camera, and the blueprint.

    Raises:
        MissingExtraError: rerun is not installed.
        OutputError: the file cannot be written.
    """
    require_rerun()
    from rpojax.interop.rerun_viewer.rrd_chunks import rerun_strict_mode

    temporary = path.with_name(f"{path.stem}.{os.getpid()}.partial.rrd")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with rerun_strict_mode():
                image_count = _record(runs, temporary, images)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: found {error.strerror or error}, expected a file that can be written") from None
    return WrittenRecording(path, runs[0].ticks, image_count, path.stat().st_size)


def _record(
    runs: Sequence[ReplayedRun[ViewerChannels]], path: Path, images: Sequence[Iterable[PosedImage] | None]
) -> int:
    """Writes the recording and returns the number of images."""
    from rpojax.interop.rerun_viewer import camera_view, scene_3d, time_plots, viewer_layout
    from rpojax.interop.rerun_viewer.rrd_chunks import RrdChunks, ServicerChunks, write_rrd

    chunks, first = RrdChunks(), runs[0]
    chunks.add_name(f"{first.file.name}, seed {first.seed}, run {first.run_id}")
    chunks.add_static(viewer_layout.ABOUT, viewer_layout.about_text(first))
    plots, count = [], 0
    for number, (run, own_images) in enumerate(zip(runs, images, strict=True)):
        name = run.servicer_name
        own = chunks if name is None else ServicerChunks(chunks, name, scene_3d.SHARED, number == 0)
        plots.append(time_plots.run_plots(run))
        scene_3d.add_scene(own, run)
        time_plots.add_plots(own, run, plots[-1])
        count += camera_view.add_camera_view(own, run, own_images)
    write_rrd(chunks, path, APPLICATION, recording_id(first), viewer_layout.blueprint(runs, plots))
    return count


def recording_id(run: ReplayedRun[ViewerChannels]) -> str:
    """Id of a recording, equal for the same run of the same scenario."""
    return f"{scenario_digest(run.file)[:16]}-seed{run.seed}-run{run.run_id}"
