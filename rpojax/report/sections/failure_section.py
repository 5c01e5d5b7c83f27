"""Failed runs by outcome, signs that tell them from completed runs, and flags that were raised and cleared."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from rpojax.physics.equipment_faults import KINDS
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import format_number, heading, metric_label
from rpojax.scenario import former_fault
from rpojax.simulation.outcomes.outcome_kinds import Outcome

_SIGNS = (
    "detection_rate",
    "outliers_accepted",
    "good_boxes_rejected_fraction",
    "longest_unseen_s",
    "nees_relative_mean",
    "look_away_peak_s",
    "delta_v_m_s",
    "formation_error_rms_m",
)
"""Metrics that tell why a run ended as it did: camera, gate, filter, control and thrust, and what came of it."""
_AT_TIME = re.compile(r" at [0-9.e+]+ s")
_MAX_FAILURES = 50
TABLE_COLUMNS = (
    ("formation_error_rms_m", 50.0),
    ("formation_error_rms_m", 95.0),
    ("min_range_m", 0.0),
    ("sigma3_coverage", 50.0),
    ("longest_unseen_s", 50.0),
)
"""Metric and percentile of each column of the table."""


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: for each outcome that is a failure the runs, times, and medians of telling metrics."""
    completed = np.asarray(campaign.completed, dtype=bool)
    failures = Counter(str(outcome) for outcome in campaign.outcomes[np.asarray(campaign.failed, dtype=bool)])
    return [_cause_entry(campaign, completed, Outcome(outcome)) for outcome, _ in failures.most_common()]


def event_entries(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: flags of failure by run and time, with the time at which each was cleared, else None."""
    return [{**asdict(event), "outcome": str(event.outcome)} for event in campaign.events]


def outcomes_text(outcomes: Mapping[str, int]) -> str:
    """Failed runs by reason, such as `2 off station, 1 lost the target`, from the number of runs by outcome."""
    failed = [(count, kind) for kind in Outcome if (count := outcomes[kind]) and kind.is_failure]
    return ", ".join(f"{count} {kind.reason}" for count, kind in sorted(failed, key=lambda each: -each[0]))


def detail_counts(failures: Sequence[Mapping[str, Any]]) -> list[tuple[str, int]]:
    """Where unfinished runs stayed and why, why others aborted, and how many of them, the most frequent first."""
    return Counter(without_time(failure["detail"]) for failure in failures if failure["detail"]).most_common()


def without_time(detail: str) -> str:
    """A detail of a failed run without the time of an abort, which is that of one run."""
    return _AT_TIME.sub("", detail)


def _cause_entry(campaign: CampaignResults, completed: np.ndarray, outcome: Outcome) -> dict[str, Any]:
    failed = np.asarray(campaign.outcomes == outcome)
    compared = failed | (completed if completed.any() else np.ones_like(completed))
    times = campaign.failed_at_s[failed]
    return {
        "outcome": str(outcome),
        "reason": outcome.reason,
        "compared_with": int(np.sum(compared & ~failed)),
        "runs": int(failed.sum()),
        "first_at_s": float(np.min(times)),
        "median_at_s": float(np.median(times)),
        "last_at_s": float(np.max(times)),
        "signs": _signs(campaign, failed, compared & ~failed),
    }


def _signs(campaign: CampaignResults, failed: np.ndarray, others: np.ndarray) -> list[dict[str, Any]]:
    """Median of each telling metric in the failed and in the other runs (runs,), None where no run has it."""
    found = []
    for name in _SIGNS:
        values = np.asarray(campaign.metrics.get(name, np.full(len(failed), np.nan)), dtype=np.float64)
        here, there = (values[chosen & np.isfinite(values)] for chosen in (failed, others))
        if len(here):
            others_median = float(np.median(there)) if len(there) else None
            found.append({"metric": name, "median": float(np.median(here)), "others": others_median})
    return found


def sign_rows(entry: Mapping[str, Any]) -> list[list[str]]:
    """Rows of an outcome's table of signs: metric with its unit, median in these runs, median in the others."""
    rows = []
    for sign in entry["signs"]:
        title = heading(metric_label(sign["metric"]))
        rows.append([title, format_number(sign["median"]), format_number(sign["others"])])
    return rows


def failure_table(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Count of each reason and detail, the first failed runs, and the number of further ones."""
    rows = summary["failures"]
    return {
        "reasons": Counter(row["reason"] for row in rows).most_common(),
        "details": Counter(
            f"{row['reason']}: {without_time(row['detail'])}" for row in rows if row["detail"]
        ).most_common(),
        "rows": [{**row, "at_s": format_number(row["at_s"])} for row in rows[:_MAX_FAILURES]],
        "more": max(0, len(rows) - _MAX_FAILURES),
    }


def event_table(events: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """First flags, the number of further ones, and a sentence on how many runs raised each and recovered."""
    rows = [
        {
            "run_id": event["run_id"],
            "reason": Outcome(event["outcome"]).reason,
            "raised_at": format_number(event["raised_at_s"]),
            "cleared_at": format_number(event["cleared_at_s"]),
        }
        for event in events[:_MAX_FAILURES]
    ]
    parts = []
    for kind in Outcome:
        raised = {event["run_id"] for event in events if event["outcome"] == kind}
        kept = {event["run_id"] for event in events if event["outcome"] == kind and event["cleared_at_s"] is None}
        if raised:
            parts.append(f"{kind.reason}: raised in {len(raised)} runs, cleared in {len(raised - kept)}")
    return {"rows": rows, "more": max(0, len(events) - _MAX_FAILURES), "sentence": "; ".join(parts) + "."}


def fault_rows(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Row for each kind of fault: runs, failed runs, percentiles of metrics; empty without the effect `faults`.

    A run with several faults is in the row of each of their kinds.
    """
    kinds = _fault_codes(campaign)
    none = KINDS.index("none")
    rows = []
    for code in sorted(set(kinds.ravel().tolist())):
        has = (kinds == code).all(axis=0) if code == none else (kinds == code).any(axis=0)
        if has.any():
            rows.append(_fault_row(campaign, code, has))
    return rows


def fault_content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: kind of fault, runs and failed runs."""
    return [{key: row[key] for key in ("kind", "runs", "failed")} for row in fault_rows(campaign)]


def headings() -> list[str]:
    """Headings of the columns of `TABLE_COLUMNS`."""
    statistics = {0.0: "smallest", 50.0: "median", 95.0: "p95"}
    shown = [(metric_label(name), statistics[percentile]) for name, percentile in TABLE_COLUMNS]
    return [f"{label.title}, {statistic}{f' [{label.unit}]' if label.unit else ''}" for label, statistic in shown]


def _fault_codes(campaign: CampaignResults) -> np.ndarray:
    """Code (faults, runs) of each fault of each run; none without the effect, and where servicers have their own."""
    scenario, runs = campaign.info.get("scenario", {}), campaign.run_ids.size
    if not scenario.get("effects", {}).get("faults"):
        return np.zeros((0, runs), dtype=int)
    codes = []
    for fault in former_fault.declared(scenario):
        drawn = campaign.drawn.get(f"faults.{fault['name']}.kind")
        if drawn is None and campaign.servicer_names:
            continue
        codes.append(np.full(runs, KINDS.index(fault["kind"])) if drawn is None else np.round(drawn).astype(int))
    return np.stack(codes) if codes else np.zeros((0, runs), dtype=int)


def _fault_row(campaign: CampaignResults, code: int, chosen: np.ndarray) -> dict[str, Any]:
    values = []
    for name, percentile in TABLE_COLUMNS:
        column = campaign.metrics[name][chosen]
        defined = column[np.isfinite(column)]
        values.append(float(np.percentile(defined, percentile)) if defined.size else None)
    return {
        "kind": KINDS[code],
        "runs": int(chosen.sum()),
        "failed": int(campaign.failed[chosen].sum()),
        "cells": ["-" if value is None else format_number(value) for value in values],
    }
