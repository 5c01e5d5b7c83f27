"""Selection of the run that a report shows in detail."""

import numpy as np

from rpojax.errors import ResultError
from rpojax.report.campaign_results import CampaignResults

_SELECTION_METRIC = "formation_error_rms_m"


def choose_run(campaign: CampaignResults, run_id: int | None = None) -> int | None:
    """Run to show in detail: `run_id`, else the median one in formation error among the stored histories, if any.

    Raises:
        ResultError: no history of `run_id` is stored.
    """
    kept = sorted(campaign.history_ids)
    if run_id is not None:
        if run_id not in kept:
            listed = ", ".join(map(str, kept[:20])) or "none"
            raise ResultError(f"run {run_id}: found no history, expected one of: {listed}")
        return run_id
    values = campaign.metrics.get(_SELECTION_METRIC, np.full(len(campaign.completed), np.nan))
    errors = dict(zip(campaign.run_ids.tolist(), values.tolist(), strict=True))
    ranked = sorted((run for run in kept if np.isfinite(errors.get(run, np.nan))), key=lambda run: errors[run])
    if ranked:
        return ranked[(len(ranked) - 1) // 2]
    return kept[0] if kept else None
