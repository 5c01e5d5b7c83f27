"""The command `rpojax film`: pictures of the rendered camera of a run."""

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from rpojax.campaign import rerender
from rpojax.campaign.rerun import check_run_id, replay_history
from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.campaign.storage.campaign_folder import Campaign, of_servicer
from rpojax.cli.exit_status import Status
from rpojax.cli.options.output import FilmCommand
from rpojax.errors import OutputError, RpojaxError
from rpojax.report.figures import camera_pictures
from rpojax.report.figures.camera_pictures import CameraFrame, TeamFrame
from rpojax.runtime.progress import items, run_progress
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import member_names


def film(asked: FilmCommand) -> int:
    """Does the work of the command; returns its exit status."""
    suffix = asked.out.suffix.lower()
    if suffix not in (".png", ".mp4"):
        raise OutputError(f"{asked.out}: found suffix {asked.out.suffix!r}, expected .png or .mp4")
    if asked.out.exists() and not asked.force:
        raise OutputError(f"{asked.out}: exists already; --force replaces it")
    if asked.every < 1:
        raise RpojaxError.of_argument("every", f"found {asked.every}, expected at least 1")

    camera_pictures.check_codec(asked.codec)
    found = Campaign(asked.directory)
    file = rerender.rendered_scenario(found.configuration.scenario, found.configuration.scenario_hash)
    run, history = _history_of(found, file, asked.run_id)
    end = rerender.valid_tick_count(history)
    # The stills of a team are chosen by what its first servicer does.
    ticks = camera_pictures.select_stills(of_servicer(history, 0) if file.servicers else history, end)
    ticks = ticks if suffix == ".png" else list(range(0, end, asked.every))
    with items("taking pictures", quiet=False) as watch:
        options = found.configuration.options
        pictures = _pictures(
            file,
            history,
            lambda own, servicer: rerender.render_images(
                file, options.seed, run, own, ticks, options.design_range, servicer
            ),
        )
        shots = _counted(pictures, len(ticks), watch)
        if suffix == ".png":
            write_atomically(asked.out, camera_pictures.png_bytes(camera_pictures.contact_sheet(shots)))
        else:
            camera_pictures.write_film(shots, asked.out, asked.codec)
    print(asked.out)
    return Status.DONE


def _history_of(found: Campaign, file: ScenarioFile, run_id: int | None) -> tuple[int, Mapping[str, np.ndarray]]:
    """Number and full history of a run, replayed if none is stored."""
    kept = found.history_ids
    run = run_id if run_id is not None else (kept or [found.configuration.options.first_run])[0]
    check_run_id(found, run)
    if run in kept and rerender.is_renderable(history := found.history(run), file):
        return run, history
    with run_progress(file.duration_s, quiet=False) as watch:
        return run, replay_history(file, found.configuration, run, watch)


def _pictures(
    file: ScenarioFile,
    history: Mapping[str, np.ndarray],
    render: Callable[[Mapping[str, np.ndarray], int | None], Iterator[CameraFrame]],
) -> Iterator[CameraFrame | TeamFrame]:
    """Pictures of the camera of a servicer, or of all cameras of a team, by the history and the number of each."""
    if not file.servicers:
        return render(history, None)

    names = member_names(file)
    cameras = [render(of_servicer(history, number), number) for number in range(len(names))]
    return (TeamFrame(dict(zip(names, shots, strict=True))) for shots in zip(*cameras, strict=True))


def _counted(
    shots: Iterable[CameraFrame | TeamFrame], total: int, watch: Callable[..., None]
) -> Iterator[CameraFrame | TeamFrame]:
    for count, shot in enumerate(shots):
        yield shot
        watch(count + 1, total)
