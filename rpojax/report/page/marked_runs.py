"""What the page knows of single runs, so that one that is picked is marked in every chart: values, traces, outcomes."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.plotly_charts import rounded_values
from rpojax.report.labels import format_number, of_all_servicers
from rpojax.report.sections.requirement_verdict_section import limit_text

MOST_RUNS: Final = 1000
_TRACE_VALUES: Final = 40_000
"""Most samples of a channel, of all runs together."""
_MOST_SAMPLES: Final = 100
_PLACEHOLDER: Final = 987_654_321
"""Run number that stands for any in the command."""
_CODES: Final = 65_534
"""Largest code of a sample; the next one stands for no value."""


def shown_rows(campaign: CampaignResults) -> np.ndarray:
    """Rows of the runs that the page knows, at most 1000: all, or those with a history, failed ones and the first."""
    runs = len(campaign.run_ids)
    if runs <= MOST_RUNS:
        return np.arange(runs)
    kept = np.flatnonzero(np.isin(campaign.run_ids, list(campaign.history_ids)))
    failed = np.flatnonzero(np.asarray(campaign.failed, dtype=bool))[: MOST_RUNS // 2]
    chosen = np.unique(np.concatenate([kept, failed]))[:MOST_RUNS]
    others = np.setdiff1d(np.arange(runs), chosen)[: MOST_RUNS - len(chosen)]
    return np.sort(np.concatenate([chosen, others]))


def run_marks(campaign: CampaignResults, content: Mapping[str, Any], channels: Sequence[str]) -> dict[str, Any]:
    """Data for the page's script: runs, what became of the failed ones, values, traces and the command to repeat one.

    Traces of `channels` are coded in 16 bits between their ends, on a logarithmic scale where all are positive.
    """
    rows = shown_rows(campaign)
    ids = campaign.run_ids[rows]
    known = set(ids.tolist())
    return {
        "ids": ids.tolist(),
        "kept": sorted(known & set(campaign.history_ids)),
        "failed": {
            str(failure["run_id"]): _failure_text(failure)
            for failure in content["failures"]
            if failure["run_id"] in known
        },
        "unjudged": ids[np.asarray(campaign.outcomes)[rows] == "not_judged"].tolist(),
        "required": [
            {
                "name": str(entry.get("of", entry["metric"])),
                "text": limit_text(entry),
                "limit": entry["limit"],
                "at_most": entry["bound"] == "at most",
            }
            for entry in content["requirements"]
        ],
        "values": {
            name: rounded_values(campaign.metrics[name][rows])
            for name in of_all_servicers(campaign.metrics)
            if np.isfinite(campaign.metrics[name]).any()
        },
        "traces": _traces(campaign, rows, channels),
        "command": shell_commands.rerun_command(campaign, _PLACEHOLDER, f"run_{_PLACEHOLDER}"),
        "placeholder": str(_PLACEHOLDER),
    }


def _failure_text(failure: Mapping[str, Any]) -> str:
    """Reason, time and cause of a failed run."""
    since = "" if failure["at_s"] is None else f" since {format_number(failure['at_s'])} s"
    more = failure["cause_text"] or failure["detail"]
    return f"{failure['reason']}{since}" + (f": {more}" if more else "")


def _traces(campaign: CampaignResults, rows: np.ndarray, channels: Sequence[str]) -> dict[str, Any] | None:
    """Times [s] and coded values of each channel; None without runs or channels."""
    named = [name for name in channels if name in campaign.traces and campaign.traces[name].size]
    if not named or not len(rows):
        return None
    count = len(campaign.trace_time_s)
    samples = max(2, min(_MOST_SAMPLES, _TRACE_VALUES // len(rows), count))
    columns = np.unique(np.linspace(0, count - 1, samples).round().astype(int))
    return {
        "time_s": rounded_values(campaign.trace_time_s[columns]),
        "channels": {name: _coded(campaign.traces[name][np.ix_(rows, columns)]) for name in named},
    }


def _coded(values: np.ndarray) -> dict[str, Any]:
    """Ends, kind of scale, and codes of `values` (runs, samples) in base 64, little-endian."""
    wide = np.asarray(values, dtype=np.float64)
    finite = wide[np.isfinite(wide)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    is_log = low > 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = np.log(wide / low) / np.log(high / low) if is_log else (wide - low) / (high - low)
    # Of equal values the share is undefined: all are at the low end.
    known = np.where(np.isfinite(shares), shares, 0.0)
    codes = np.where(np.isfinite(wide), np.round(_CODES * known), _CODES + 1).astype("<u2")
    return {"low": low, "high": high, "log": is_log, "codes": base64.b64encode(codes.tobytes()).decode()}
