"""One servicer of a team as the results of a campaign of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.mission import unfinished_section
from rpojax.simulation.outcomes import outcome_kinds
from rpojax.simulation.outcomes.outcome_events import OutcomeEvent
from rpojax.simulation.outcomes.outcome_kinds import REASONS, Outcome


@dataclass(frozen=True)
class ServicerResults:
    """`CampaignResults` of one servicer; without what is kept of teams only: events, maps of the surface, histories."""

    directory: Path
    info: Mapping[str, Any]
    run_ids: np.ndarray
    metrics: Mapping[str, np.ndarray]
    completed: np.ndarray
    failed: np.ndarray
    outcomes: np.ndarray
    reached_end: np.ndarray
    is_judged: np.ndarray
    failed_at_s: np.ndarray
    failure_reason: np.ndarray
    drawn: Mapping[str, np.ndarray]
    trace_time_s: np.ndarray
    traces: Mapping[str, np.ndarray]
    phases: Mapping[str, np.ndarray]
    phase_names: Sequence[str]
    events: Sequence[OutcomeEvent] = ()
    coverage: Mapping[str, np.ndarray] = field(default_factory=dict)
    surface: Mapping[str, np.ndarray] = field(default_factory=dict)
    history_ids: Sequence[int] = ()
    servicer_names: Sequence[str] = ()

    def servicers(self, group: str) -> Mapping[str, np.ndarray]:
        """Nothing: a servicer has no servicers."""
        return {}

    def history(self, run_id: int, servicer: int | None = None) -> Mapping[str, np.ndarray]:
        """Nothing is kept here; raises KeyError."""
        raise KeyError(run_id)


def of_servicer(campaign: CampaignResults, number: int) -> ServicerResults:
    """Results of the servicer `number` of a team."""
    name = campaign.servicer_names[number]
    status = campaign.servicers("status")
    codes = status["failure"][:, number]
    outcomes = outcome_kinds.of_codes(codes)
    drawn = {key: values for key, values in campaign.drawn.items() if "/" not in key}
    return ServicerResults(
        directory=campaign.directory,
        info=_with_own_tables(campaign.info, name),
        run_ids=campaign.run_ids,
        metrics=_of_one(campaign, "metrics", number),
        completed=codes == Outcome.COMPLETED.code,
        failed=outcome_kinds.is_failed(outcomes),
        outcomes=outcomes,
        # A team's run is frozen as a whole, by whichever servicer.
        reached_end=campaign.reached_end,
        is_judged=campaign.is_judged,
        failed_at_s=np.where(campaign.reached_end, status["failed_at_s"][:, number], campaign.failed_at_s),
        failure_reason=np.array(REASONS)[codes],
        drawn=drawn
        | {key.removesuffix(f"/{name}"): values for key, values in campaign.drawn.items() if key.endswith(f"/{name}")},
        trace_time_s=campaign.trace_time_s,
        traces=_of_one(campaign, "traces", number),
        phases=_of_one(campaign, "phases", number),
        phase_names=campaign.phase_names,
    )


def unfinished_details(campaign: CampaignResults) -> dict[int, str]:
    """Where each unfinished run stayed and why, by its number; of a team for each servicer that did not finish."""
    if not campaign.servicer_names:
        return unfinished_section.details(campaign)
    found: dict[int, list[str]] = {}
    for number, name in enumerate(campaign.servicer_names):
        for run_id, text in unfinished_section.details(of_servicer(campaign, number)).items():
            found.setdefault(run_id, []).append(f"{name} {text}")
    # A run has the outcome of its worst servicer.
    of_team = campaign.run_ids[np.asarray(campaign.outcomes) == Outcome.UNFINISHED].tolist()
    return {run_id: "; ".join(texts) for run_id, texts in found.items() if run_id in of_team}


def _with_own_tables(info: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Information on the campaign with the goal and the limits of one servicer."""
    scenario = info.get("scenario", {})
    changes = next((each for each in scenario.get("servicers", []) if each.get("name") == name), {})
    own = {key: {**(scenario.get(key) or {}), **(changes.get(key) or {})} for key in ("goal", "limits")}
    return {**info, "scenario": {**scenario, **own}}


def _of_one(campaign: CampaignResults, group: str, number: int) -> dict[str, np.ndarray]:
    return {name: values[:, number] for name, values in campaign.servicers(group).items()}
