"""Recording of a run for the rerun viewer: scene, camera and plots over simulation time."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from rpojax.errors import OutputError
from rpojax.interop.rerun_viewer.rrd_chunks import TIMELINE, ViewerChannels, servicer_path
from rpojax.interop.rerun_viewer.scene_3d import CAMERA, HILL
from rpojax.interop.rerun_viewer.time_plots import MODE, PLOTS, Plot
from rpojax.interop.run_replay import PosedImage, ReplayedRun
from rpojax.optional_packages import require_package
from rpojax.scenario.scenario_digest import scenario_digest

ABOUT = "about"
_BACKGROUND_COLOR = (14, 17, 24)
APPLICATION = "rpojax"


def blueprint(runs: Sequence[ReplayedRun[ViewerChannels]], plots: Sequence[Sequence[Plot]]) -> rrb.Blueprint:
    """Blueprint of the views of a run of one servicer, or of a team: its cameras side by side, plots in tabs."""
    first = runs[0]
    about = rrb.TextDocumentView(origin=ABOUT, name="About")
    cameras = [_camera_view(run) for run in runs]
    left = rrb.Vertical(_scene_view(first), rrb.Horizontal(*cameras, about), row_shares=[3, 2])
    rights = [_plots_view(run, own) for run, own in zip(runs, plots, strict=True)]
    right = rights[0] if len(rights) == 1 else rrb.Tabs(*rights)
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1, 1]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, playback_speed=20.0),
        auto_layout=False,
        auto_views=False,
    )


def _plots_view(run: ReplayedRun[ViewerChannels], plots: Sequence[Plot]) -> rrb.Vertical:
    """Plots of a servicer over its modes."""
    views = [
        rrb.TimeSeriesView(
            origin=servicer_path(f"{PLOTS}/{plot.name}", run.servicer_name),
            name=plot.title,
            plot_legend=rrb.PlotLegend(visible=False),
            axis_x=_full_time_range(run),
        )
        for plot in plots
    ]
    mode = rrb.StateTimelineView(
        origin=servicer_path(MODE, run.servicer_name), name="Mode", time_view=_full_time_range(run)
    )
    return rrb.Vertical(rrb.Grid(*views, grid_columns=2), mode, row_shares=[7, 1], name=run.servicer_name)


def _full_time_range(run: ReplayedRun[ViewerChannels]) -> rrb.archetypes.TimeAxis:
    """Time axis over the whole run."""
    ends = (rr.TimeRangeBoundary.absolute(seconds=float(run.time_s[index])) for index in (0, -1))
    return rrb.archetypes.TimeAxis(view_range=rr.TimeRange(*ends))


def _scene_view(run: ReplayedRun[ViewerChannels]) -> rrb.Spatial3DView:
    """3-D view from the side of the orbit normal, with start and target in view."""
    start = run.values["rho_H"][0]
    middle = 0.5 * start
    away = 0.9 * float(np.linalg.norm(start)) + 5.0
    eye = middle + away * np.array([0.45, -0.35, 0.9])
    return rrb.Spatial3DView(
        origin=HILL,
        name="Hill frame of the target",
        line_grid=False,
        background=_BACKGROUND_COLOR,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=middle, eye_up=[1.0, 0.0, 0.0]),
    )


def _camera_view(run: ReplayedRun[ViewerChannels]) -> rrb.Spatial2DView:
    camera, name = run.servicer_file.camera, run.servicer_name
    bounds = rrb.VisualBounds2D(x_range=[0.0, camera.width_px], y_range=[0.0, camera.height_px])
    title = "Camera" if name is None else f"Camera of {name}"
    return rrb.Spatial2DView(origin=servicer_path(CAMERA, name), name=title, visual_bounds=bounds)


def about_text(run: ReplayedRun[ViewerChannels]) -> rr.TextDocument:
    """Description of the run and of the colours."""
    lines = [
        f"## {run.file.name}, run {run.run_id} of seed {run.seed}",
        run.file.description,
        "Replayed from its seed and run id. Time is simulation time.",
        "**Scene**: Hill frame of the target, radial up; metres. Blue is the truth, orange the estimate of flight "
        "software with its 3-sigma ellipsoid. Green: the desired position. Red arrow: thruster force, 5 m at nominal "
        "thrust. Grey sphere: keep-out. Target: convex hull of its outline, with its true axes, and longer ones of its "
        "estimated attitude where flight software has one. Servicer: cube of its mean cross-section.",
        "**Camera**: green box accepted by the filter, orange box rejected, blue the gate for the box "
        "center, grey the true outline.",
    ]
    return rr.TextDocument("\n\n".join(lines), media_type=rr.MediaType.MARKDOWN)


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
    from rpojax.interop.rerun_viewer import rrd_recording, scene_3d, time_plots
    from rpojax.interop.rerun_viewer.rrd_chunks import RrdChunks, ServicerChunks, write_rrd

    chunks, first = RrdChunks(), runs[0]
    chunks.add_name(f"{first.file.name}, seed {first.seed}, run {first.run_id}")
    chunks.add_static(rrd_recording.ABOUT, rrd_recording.about_text(first))
    plots, count = [], 0
    for number, (run, own_images) in enumerate(zip(runs, images, strict=True)):
        name = run.servicer_name
        own = chunks if name is None else ServicerChunks(chunks, name, scene_3d.SHARED, number == 0)
        plots.append(time_plots.run_plots(run))
        scene_3d.add_scene(own, run)
        time_plots.add_plots(own, run, plots[-1])
        count += scene_3d.add_camera_view(own, run, own_images)
    write_rrd(chunks, path, APPLICATION, recording_id(first), rrd_recording.blueprint(runs, plots))
    return count


def recording_id(run: ReplayedRun[ViewerChannels]) -> str:
    """Id of a recording, equal for the same run of the same scenario."""
    return f"{scenario_digest(run.file)[:16]}-seed{run.seed}-run{run.run_id}"
