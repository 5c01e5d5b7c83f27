"""The verb `rpojax export-bag`: one run of a campaign as a ROS 2 bag."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from rpojax.cli import console, replay
from rpojax.cli.arguments import AsJson, Folder, NoCache, Status, print_json
from rpojax.runtime.jax_environment import prepare_jax

if TYPE_CHECKING:
    from rpojax.interop.ros2.message_values import TickValues
    from rpojax.interop.run_replay import Agreement, Flight


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
    """One run of a campaign as a ROS 2 bag, without ROS; the run is flown again, alone."""
    prepare_jax(cache=not no_cache)
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.interop.ros2 import bag_writing, message_values
    from rpojax.interop.ros2.message_types import typestore

    typestore()
    bag_writing.claim(out, force)
    found = Campaign(directory)
    kind = bag_writing.images_of(found.asked["scenario"]["camera"]["model"], images)
    begin = time.perf_counter()
    flight, agreement = replay.fly_again(found, run_id, message_values.observe, as_json)
    flown = time.perf_counter()
    with console.counting("writing ticks", quiet=as_json) as watch:
        count = bag_writing.export(flight, out, bag_writing.Format(form), kind, force, watch)
    _tell(out, count, flight, agreement, {"fly_s": flown - begin, "write_s": time.perf_counter() - flown}, as_json)
    return Status.DONE


def _tell(
    out: Path,
    count: int,
    flight: "Flight[TickValues]",
    agreement: "Agreement | None",
    took: dict[str, float],
    as_json: bool,
) -> None:
    content: dict[str, Any] = {"bag": str(out), "run_id": flight.run_id, "ticks": flight.ticks, "messages": count}
    if as_json:
        print_json({**content, "agreement": replay.content(agreement), **took})
        return
    print(out)
    print(f"{count} messages of {flight.ticks} ticks")
    print(replay.sentence(flight, agreement))
