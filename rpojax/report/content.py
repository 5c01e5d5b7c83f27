"""All that report.json holds and the page shows."""

from typing import Any

from rpojax.report import (
    causes,
    consistency,
    convergence,
    detections,
    dispersions,
    limits,
    safety,
    sensitivity,
    worst,
)
from rpojax.report.dispersions import Dispersion
from rpojax.report.results import Results
from rpojax.report.summary import summarise
from rpojax.report.values import plain


def report_content(campaign: Results, drawn: list[Dispersion] | None = None) -> dict[str, Any]:
    """Content of report.json: what `summarise` gives, and a part from every module that judges the runs.

    `drawn` are the dispersions as drawn, where they are known already.
    """
    summary = summarise(campaign)
    lines = detections.by_range(campaign.history(run) for run in sorted(campaign.history_ids))
    parts = {
        "safety": safety.content(campaign),
        "consistency": consistency.content(campaign),
        "convergence": convergence.content(campaign),
        "dispersions": [one.content() for one in (dispersions.as_drawn(campaign) if drawn is None else drawn)],
        "sensitivity": sensitivity.content(campaign),
        "failure_causes": causes.content(campaign),
        "worst_runs": worst.content(campaign),
        "detections": lines,
        "limits": limits.sentences(campaign, summary),
    }
    return {**summary, **plain(parts)}
