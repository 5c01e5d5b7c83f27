"""The command `rpojax export-bag`: one run of a campaign as a ROS 2 bag."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from rpojax.cli import replay
from rpojax.cli.arguments import AsJson, Folder, NoCache
from rpojax.cli.exit_status import Status
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.jax_environment import prepare_jax
from rpojax.runtime.progress import items

if TYPE_CHECKING:
    from rpojax.interop.ros2.message_values import RosTickValues
    from rpojax.interop.run_replay import ReplayAgreement, ReplayedRun


def export_bag(
    directory: Folder,
    *,
    out: Annotated[Path, arg(metavar="BAG", help="Folder to make; its files have its name.")],
    run_id: Annotated[int, arg(metavar="I", help="Number of the run.")],
    form: Annotated[
        Literal["mcap", "sqlite3"], arg(name="format", help="Storage: mcap for Foxglove and Iron or later, or sqlite3.")
    ] = "mcap",
    images: Annotated[
        Literal["auto", "raw", "compressed", "none"],
        arg(help="Pictures of a rendered camera: raw, compressed (PNG) or none; auto: raw where there are any."),
    ] = "auto",
    force: Annotated[bool, arg(help="Replace the bag if there is one.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """Write one run of a campaign as a ROS 2 bag, without ROS, a namespace per servicer; the run is replayed."""
    prepare_jax(cache=not no_cache)
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.interop import run_replay
    from rpojax.interop.ros2 import mcap_or_sqlite3_writer, message_values, run_bag
    from rpojax.interop.ros2.message_types import typestore

    typestore()
    mcap_or_sqlite3_writer.check_output(out, force)
    found = Campaign(directory)
    kind = run_bag.resolve_image_storage(found.configuration.scenario["camera"]["model"], images)
    begin = time.perf_counter()
    runs = replay.replay_servicers(found, run_id, message_values.observe_tick, as_json)
    agreement = run_replay.compare_with_campaign(run := runs[0], found)
    replayed, storage = time.perf_counter(), mcap_or_sqlite3_writer.BagFormat(form)
    with items("writing ticks", quiet=as_json) as watch:
        if found.file.servicers:
            count = run_bag.write_team(runs, out, storage, kind, force, watch)
        else:
            count = run_bag.write_run(run, out, storage, kind, force, watch)
    _print_result(
        out, count, run, agreement, {"fly_s": replayed - begin, "write_s": time.perf_counter() - replayed}, as_json
    )
    return Status.DONE


def _print_result(
    out: Path,
    count: int,
    run: "ReplayedRun[RosTickValues]",
    agreement: "ReplayAgreement | None",
    took: dict[str, float],
    as_json: bool,
) -> None:
    content: dict[str, Any] = {"bag": str(out), "run_id": run.run_id, "ticks": run.ticks, "messages": count}
    if as_json:
        print_json({**content, "agreement": replay.content(agreement), **took})
        return
    print(out)
    print(f"{count} messages of {run.ticks} ticks")
    print(replay.sentence(run, agreement))
