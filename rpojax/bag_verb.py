"""The verb `rpojax export-bag`: one run of a campaign as a ROS 2 bag."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from rpojax import console
from rpojax.machine import prepare_jax
from rpojax.verb_parts import AsJson, Folder, NoCache, Status, fly, print_json

if TYPE_CHECKING:
    from rpojax.campaign.store import Campaign
    from rpojax.interop.flight_record import Agreement, Flight


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
    from rpojax.interop import flight_record, ros_bag
    from rpojax.interop.message_types import typestore

    typestore()
    ros_bag.claim(out, force)
    found = Campaign(directory)
    kind = ros_bag.images_of(found.asked["scenario"]["camera"]["model"], images)
    begin = time.perf_counter()
    flights: list[Flight] = []

    def work(watch: console.Watch) -> "Campaign":
        flights.append(flight_record.fly(found, run_id, on_progress=watch))
        return found

    fly(work, found.file.duration_s, as_json)
    flight, flown = flights[0], time.perf_counter()
    agreement = flight_record.compare(flight, found)
    with console.counting("writing ticks", quiet=as_json) as watch:
        count = ros_bag.export(flight, out, ros_bag.Format(form), kind, force, watch)
    _tell(out, count, flight, agreement, {"fly_s": flown - begin, "write_s": time.perf_counter() - flown}, as_json)
    return Status.DONE


def _tell(
    out: Path, count: int, flight: "Flight", agreement: "Agreement | None", took: dict[str, float], as_json: bool
) -> None:
    content: dict[str, Any] = {"bag": str(out), "run_id": flight.run_id, "ticks": flight.ticks, "messages": count}
    if as_json:
        same = agreement and {
            "samples": agreement.samples,
            "range_difference_m": agreement.range_difference_m,
            "same_end": agreement.same_end,
        }
        print_json({**content, "agreement": same, **took})
        return
    print(out)
    print(f"{count} messages of {flight.ticks} ticks")
    if agreement is None:
        print("the campaign has not flown this run yet")
    else:
        end = "the same end" if agreement.same_end else "ANOTHER END"
        off = f"{agreement.range_difference_m:.2g} m"
        print(f"flown again: range within {off} of the {agreement.samples} samples that the campaign kept, {end}")
