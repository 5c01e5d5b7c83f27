"""Replay of one recorded run for export commands, and its agreement with the record."""

import dataclasses
from typing import Any

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import run_replay
from rpojax.interop.run_replay import ReplayAgreement, ReplayedRun, TickObserver
from rpojax.runtime.progress import run_progress


def replay_servicers(found: Campaign, run_id: int, observe: TickObserver, as_json: bool) -> tuple[ReplayedRun, ...]:
    """Replay of a campaign's run for each servicer of a team, or for the one servicer."""
    with run_progress(found.file.duration_s, quiet=as_json) as watch:
        return run_replay.replay_servicers(found, run_id, observe, on_progress=watch)


def content(agreement: ReplayAgreement | None) -> dict[str, Any] | None:
    """The agreement as JSON content."""
    return None if agreement is None else dataclasses.asdict(agreement)


def sentence(flight: ReplayedRun, agreement: ReplayAgreement | None) -> str:
    """The agreement in one sentence."""
    how = "replayed in double precision" if flight.file.precision == "single" else "replayed"
    if agreement is None:
        return f"{how}; the campaign has not recorded this run yet"
    end = "the same end" if agreement.same_end else "ANOTHER END"
    off = f"{agreement.range_difference_m:.2g} m"
    return f"{how}: range within {off} of the {agreement.samples} samples that the campaign kept, {end}"
