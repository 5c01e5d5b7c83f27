"""The command `rpojax export-rrd`: one run as a recording for the rerun viewer."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax.cli import replay
from rpojax.cli.arguments import AsJson, Folder, NoCache
from rpojax.cli.exit_status import Status
from rpojax.cli.output_paths import claim
from rpojax.cli.standard_streams import print_json
from rpojax.errors import RpojaxError
from rpojax.runtime.jax_environment import prepare_jax
from rpojax.runtime.progress import items

if TYPE_CHECKING:
    from rpojax.interop.rerun_viewer.rrd_chunks import ViewerChannels
    from rpojax.interop.run_replay import PosedImage, ReplayedRun


def export_rrd(
    directory: Folder,
    *,
    run_id: Annotated[int, arg(metavar="I", help="Run to show.")],
    out: Annotated[Path, arg(metavar="FILE", help="Recording to write (.rrd).")],
    every: Annotated[int, arg(metavar="N", help="Ticks from one picture of a rendered camera to the next.")] = 1,
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Write one run for the rerun viewer: both spacecraft, the camera and plots; the run is replayed."""
    claim(out, force, (".rrd",))
    if every < 1:
        raise RpojaxError.of_argument("every", f"found {every}, expected at least 1")
    prepare_jax(cache=not no_cache)
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.interop import run_replay
    from rpojax.interop.rerun_viewer import rrd_chunks, rrd_recording

    rrd_recording.require_rerun()
    found = Campaign(directory)
    runs = replay.replay_servicers(found, run_id, rrd_chunks.observe_tick, as_json)
    agreement = run_replay.compare_with_campaign(run := runs[0], found)
    with items("writing the recording", quiet=as_json) as watch:
        written = rrd_recording.write_servicers(runs, out, [_shots(each, every, watch) for each in runs])
    if as_json:
        told = {"ticks": written.ticks, "pictures": written.images, "size_bytes": written.size_bytes}
        print_json({"file": str(out), "run_id": run_id, **told, "agreement": replay.content(agreement)})
    else:
        print(out)
        print(replay.sentence(run, agreement))
    return Status.DONE


def _shots(run: "ReplayedRun[ViewerChannels]", every: int, watch: Callable[..., None]) -> "Iterator[PosedImage] | None":
    """Pictures of a rendered camera; None for other camera models."""
    if run.file.camera.model != "rendered":
        return None
    from rpojax.interop import run_replay

    ticks = range(0, run.ticks, every)

    def counted() -> "Iterator[PosedImage]":
        for count, shot in enumerate(run_replay.rerendered_images(run, ticks)):
            yield shot
            watch(count + 1, len(ticks))

    return counted()
