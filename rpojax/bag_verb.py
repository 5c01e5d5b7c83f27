"""The verb `rpojax export-bag`: one run of a campaign as a ROS 2 bag."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from rpojax import console, flown_again
from rpojax.machine import prepare_jax
from rpojax.verb_parts import AsJson, Folder, NoCache, Status, print_json

if TYPE_CHECKING:
    from rpojax.interop.flight_record import Agreement, Flight
    from rpojax.interop.tick_values import TickValues


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
    from rpojax.campaign.store import Campaign
    from rpojax.interop import ros_bag, tick_values
    from rpojax.interop.message_types import typestore

    typestore()
    ros_bag.claim(out, force)
    found = Campaign(directory)
    kind = ros_bag.images_of(found.asked["scenario"]["camera"]["model"], images)
    begin = time.perf_counter()
    flight, agreement = flown_again.fly_again(found, run_id, tick_values.observe, as_json)
    flown = time.perf_counter()
    with console.counting("writing ticks", quiet=as_json) as watch:
        count = ros_bag.export(flight, out, ros_bag.Format(form), kind, force, watch)
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
        print_json({**content, "agreement": flown_again.content(agreement), **took})
        return
    print(out)
    print(f"{count} messages of {flight.ticks} ticks")
    print(flown_again.sentence(flight, agreement))
