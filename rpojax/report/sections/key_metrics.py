"""The few metrics that sensitivity, convergence and the worst runs are about."""

import numpy as np

from rpojax.report.campaign_protocol import Results
from rpojax.report.labels import ordered

_ALWAYS = {"formation_error_rms_m", "nav_relative_position_error_rms_m", "delta_v_m_s", "min_range_m"}
_FEWEST_RUNS = 10
_MOST = 8


def leading_metrics(campaign: Results) -> list[str]:
    """Names of at most eight metrics that vary over ten runs or more: those of requirements, and the usual ones."""
    required = {str(entry["metric"]) for entry in campaign.info.get("scenario", {}).get("requirements") or []}
    found = [name for name in ordered(campaign.metrics) if varies(campaign.metrics[name])]
    chosen = [name for name in found if name in required][:_MOST]
    chosen += [name for name in found if name in _ALWAYS - required][: _MOST - len(chosen)]
    return ordered(chosen)


def varies(values: np.ndarray) -> bool:
    """Whether enough runs have a metric, and not all the same."""
    defined = values[np.isfinite(values)]
    return len(defined) >= _FEWEST_RUNS and float(np.ptp(defined)) > 0.0
