"""Key metrics, for which the report shows sensitivity, convergence and worst runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpojax.metrics.time_windows import MetricWindow
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import in_display_order

_DEFAULT_METRICS = {"formation_error_rms_m", "nav_relative_position_error_rms_m", "delta_v_m_s", "min_range_m"}
_MIN_RUNS = 10
_MAX_METRICS = 8


def select_key_metrics(campaign: CampaignResults) -> list[str]:
    """Names of at most eight metrics that vary over ten runs or more: those with requirements, then the defaults."""
    required = {_metric_name(entry) for entry in campaign.info.get("scenario", {}).get("requirements") or []}
    found = [name for name in in_display_order(campaign.metrics) if has_variation(campaign.metrics[name])]
    chosen = [name for name in found if name in required][:_MAX_METRICS]
    chosen += [name for name in found if name in _DEFAULT_METRICS - required][: _MAX_METRICS - len(chosen)]
    return in_display_order(chosen)


def _metric_name(requirement: Mapping[str, Any]) -> str:
    window = MetricWindow(*(requirement.get(key) for key in ("phase", "at", "from_s", "to_s")))
    return f"{requirement['metric']}{window.suffix}"


def has_variation(values: np.ndarray) -> bool:
    """Whether a metric is defined in enough runs and not equal in all of them."""
    defined = values[np.isfinite(values)]
    return len(defined) >= _MIN_RUNS and float(np.ptp(defined)) > 0.0
