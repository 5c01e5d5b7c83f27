"""What verbs that tell of one run share: it is flown again, and they say how far that is from what was recorded."""

import dataclasses
from typing import TYPE_CHECKING, Any

from rpojax.cli.arguments import fly

if TYPE_CHECKING:
    from rpojax.campaign.storage.campaign_folder import Campaign
    from rpojax.cli import console
    from rpojax.interop.run_replay import Agreement, Flight, Observe


def fly_again(found: "Campaign", run_id: int, observe: "Observe", as_json: bool) -> "tuple[Flight, Agreement | None]":
    """A run of a campaign flown again, and how it compares with what the campaign recorded of it."""
    from rpojax.interop import run_replay

    flights: list[Flight] = []

    def work(watch: "console.Watch") -> "Campaign":
        flights.append(run_replay.fly(found, run_id, observe, on_progress=watch))
        return found

    fly(work, found.file.duration_s, as_json)
    return flights[0], run_replay.compare(flights[0], found)


def content(agreement: "Agreement | None") -> dict[str, Any] | None:
    """The comparison for other programs."""
    return None if agreement is None else dataclasses.asdict(agreement)


def sentence(flight: "Flight", agreement: "Agreement | None") -> str:
    """The comparison for people."""
    how = "flown again in double precision" if flight.file.precision == "single" else "flown again"
    if agreement is None:
        return f"{how}; the campaign has not recorded this run yet"
    end = "the same end" if agreement.same_end else "ANOTHER END"
    off = f"{agreement.range_difference_m:.2g} m"
    return f"{how}: range within {off} of the {agreement.samples} samples that the campaign kept, {end}"
