"""The command `rpojax export-bag`: one run of a campaign as a ROS 2 bag."""

import time
from pathlib import Path
from typing import Any

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import replay
from rpojax.cli.exit_status import Status
from rpojax.cli.options.output import ExportBagCommand
from rpojax.cli.standard_streams import print_json
from rpojax.interop import run_replay
from rpojax.interop.ros2 import mcap_or_sqlite3_writer, message_values, run_bag
from rpojax.interop.ros2.message_types import typestore
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayAgreement, ReplayedRun
from rpojax.runtime.progress import items


def export_bag(asked: ExportBagCommand) -> int:
    """Does the work of the command; returns its exit status."""
    typestore()
    mcap_or_sqlite3_writer.check_output(asked.out, asked.force)
    found = Campaign(asked.directory)
    kind = run_bag.resolve_image_storage(found.configuration.scenario["camera"]["model"], asked.images)
    begin = time.perf_counter()
    runs = replay.replay_servicers(found, asked.run_id, message_values.observe_tick, asked.as_json)
    run, agreement = runs[0], run_replay.compare_all(runs, found)
    replayed, storage = time.perf_counter(), mcap_or_sqlite3_writer.BagFormat(asked.form)
    with items("writing ticks", quiet=asked.as_json) as watch:
        if found.file.servicers:
            count = run_bag.write_team(runs, asked.out, storage, kind, asked.force, watch)
        else:
            count = run_bag.write_run(run, asked.out, storage, kind, asked.force, watch)
    _print_result(
        asked.out,
        count,
        run,
        agreement,
        {"fly_s": replayed - begin, "write_s": time.perf_counter() - replayed},
        asked.as_json,
    )
    return Status.DONE


def _print_result(
    out: Path,
    count: int,
    run: ReplayedRun[RosTickValues],
    agreement: ReplayAgreement | None,
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
