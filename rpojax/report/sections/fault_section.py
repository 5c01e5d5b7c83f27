"""Results by kind of equipment fault."""

from typing import Any

import numpy as np

from rpojax.physics.equipment_faults import KINDS
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.labels import metric_label
from rpojax.report.number_format import format_number

TABLE_COLUMNS = (
    ("formation_error_rms_m", 50.0),
    ("formation_error_rms_m", 95.0),
    ("min_range_m", 0.0),
    ("sigma3_coverage", 50.0),
    ("longest_unseen_s", 50.0),
)
"""Metric and percentile of each column of the table."""


def fault_rows(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Row for each kind of fault: runs, failed runs, percentiles of metrics; empty without the effect `faults`."""
    kinds = _fault_codes(campaign)
    return [_fault_row(campaign, code, kinds == code) for code in sorted(set(kinds.tolist()))]


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: kind of fault, runs and failed runs."""
    return [{key: row[key] for key in ("kind", "runs", "failed")} for row in fault_rows(campaign)]


def headings() -> list[str]:
    """Headings of the columns of `TABLE_COLUMNS`."""
    statistics = {0.0: "smallest", 50.0: "median", 95.0: "p95"}
    shown = [(metric_label(name), statistics[percentile]) for name, percentile in TABLE_COLUMNS]
    return [f"{label.title}, {statistic}{f' [{label.unit}]' if label.unit else ''}" for label, statistic in shown]


def _fault_codes(campaign: CampaignResults) -> np.ndarray:
    """Fault code of each run (runs,); empty without the effect `faults`, and where servicers have their own."""
    scenario = campaign.info.get("scenario", {})
    if not scenario.get("effects", {}).get("faults"):
        return np.zeros(0, dtype=int)
    drawn = campaign.drawn.get("fault.kind")
    if drawn is None and campaign.servicer_names:
        return np.zeros(0, dtype=int)
    if drawn is None:
        return np.full(campaign.run_ids.size, KINDS.index(scenario["fault"]["kind"]))
    return np.round(drawn).astype(int)


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
