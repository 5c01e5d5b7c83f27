"""The command `rpojax export-rrd`: one run as a recording for the rerun viewer."""

from collections.abc import Callable, Iterator
from typing import Any

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import replay
from rpojax.cli.exit_status import Status
from rpojax.cli.options.output import ExportRrdCommand
from rpojax.cli.output_paths import claim
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.interop import run_replay
from rpojax.interop.run_replay import PosedImage, ReplayedRun
from rpojax.optional_packages import require_package
from rpojax.runtime.progress import items


def export_rrd(asked: ExportRrdCommand) -> int:
    """Does the work of the command; returns its exit status."""
    claim(asked.out, asked.force, (".rrd",))
    if asked.every < 1:
        raise RpojaxError.of_argument("every", f"found {asked.every}, expected at least 1")

    require_package("rerun")
    from rpojax.interop.rerun_viewer import rrd_chunks, rrd_recording

    found = Campaign(asked.directory)
    runs = replay.replay_servicers(found, asked.run_id, rrd_chunks.observe_tick, asked.as_json)
    run, agreement = runs[0], run_replay.compare_all(runs, found)
    with items("writing the recording", quiet=asked.as_json) as watch:
        written = rrd_recording.write_servicers(runs, asked.out, [_shots(each, asked.every, watch) for each in runs])
    if asked.as_json:
        told = {"ticks": written.ticks, "pictures": written.images, "size_bytes": written.size_bytes}
        print_json({"file": str(asked.out), "run_id": asked.run_id, **told, "agreement": replay.content(agreement)})
    else:
        print(asked.out)
        print(replay.sentence(run, agreement))
    return Status.DONE


def _shots(run: ReplayedRun[Any], every: int, watch: Callable[..., None]) -> Iterator[PosedImage] | None:
    """Pictures of a rendered camera; None for other camera models."""
    if run.file.camera.model != "rendered":
        return None

    ticks = range(0, run.ticks, every)

    def counted() -> Iterator[PosedImage]:
        for count, shot in enumerate(run_replay.rerendered_images(run, ticks)):
            yield shot
            watch(count + 1, len(ticks))

    return counted()
