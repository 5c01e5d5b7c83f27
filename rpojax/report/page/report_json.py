"""All that report.json holds and the page shows."""

from typing import Any

from rpojax.report.campaign_protocol import Results
from rpojax.report.json_values import plain
from rpojax.report.sections import (
    caveats,
    consistency_section,
    convergence_section,
    detection_section,
    dispersion_section,
    failure_causes,
    safety_section,
    sensitivity_section,
    worst_runs,
)
from rpojax.report.sections.dispersion_section import Dispersion
from rpojax.report.sections.summary import summarise


def report_content(campaign: Results, drawn: list[Dispersion] | None = None) -> dict[str, Any]:
    """Content of report.json: what `summarise` gives, and a part from every module that judges the runs.

    `drawn` are the dispersions as drawn, where they are known already.
    """
    summary = summarise(campaign)
    lines = detection_section.by_range(campaign.history(run) for run in sorted(campaign.history_ids))
    parts = {
        "safety": safety_section.content(campaign),
        "consistency": consistency_section.content(campaign),
        "convergence": convergence_section.content(campaign),
        "dispersions": [one.content() for one in (dispersion_section.as_drawn(campaign) if drawn is None else drawn)],
        "sensitivity": sensitivity_section.content(campaign),
        "failure_causes": failure_causes.content(campaign),
        "worst_runs": worst_runs.content(campaign),
        "detections": lines,
        "limits": caveats.sentences(campaign, summary),
    }
    return {**summary, **plain(parts)}
