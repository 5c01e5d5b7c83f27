"""Drivers: inputs and pairs of inputs that go with failures, violated requirements and the tails of key metrics."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from rpojax.analysis.statistics.drivers import LEVEL, MIN_EVENTS, Driver, drivers
from rpojax.report.campaign_results import (
    CampaignResults,
    dispersed_scalars,
    is_categorical,
    runs_are_independent,
    select_key_metrics,
)
from rpojax.report.labels import format_number, metric_label
from rpojax.report.sections.requirement_verdict_section import limit_text
from rpojax.scenario.schema import RequirementSection
from rpojax.simulation.outcomes.outcome_kinds import Outcome
from rpojax.simulation.outcomes.requirement_violations import counts, required_values, violates

_TAIL: Final = 0.1
"""Share of runs that are the tail of a metric."""
_MOST_SHOWN: Final = 20


def content(campaign: CampaignResults) -> dict[str, Any]:
    """Part of report.json: events that were tested, and their drivers, the surest first.

    Empty for dependent runs, of which chance cannot be told, and with too few runs.
    """
    inputs = {key: values for key, values in dispersed_scalars(campaign).items() if np.isfinite(values).all()}
    events = _events(campaign) if runs_are_independent(campaign) and inputs else {}
    found = drivers(inputs, events, [key for key in inputs if is_categorical(key)])
    return {
        "level": LEVEL,
        "inputs": len(inputs),
        "events": [
            {"event": name, "runs": int(np.sum(np.isfinite(flags))), "count": int(np.nansum(flags))}
            for name, flags in events.items()
        ],
        "drivers": [_entry(one) for one in sorted(found, key=lambda one: (one.q_value, one.p_value))],
    }


def _entry(one: Driver) -> dict[str, Any]:
    return {
        "event": one.event,
        "inputs": list(one.inputs),
        "p": one.p_value,
        "q": one.q_value,
        "parts": [list(part) for part in one.parts],
        "runs": one.runs.tolist(),
        "count": one.events.tolist(),
    }


def _events(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Name -> (runs,) 1 where a run has the event, 0 where not, NaN where it does not count."""
    outcomes = np.asarray(campaign.outcomes)
    events = {
        kind.reason: (outcomes == kind).astype(np.float64) for kind in Outcome if kind.is_failure and kind in outcomes
    }
    told = set()
    for entry in campaign.info.get("scenario", {}).get("requirements") or []:
        requirement = RequirementSection.model_validate(entry)
        if requirement.metric_name not in campaign.metrics:
            continue
        counted = counts(requirement, campaign.metrics, outcomes)
        broken = violates(requirement, required_values(requirement, campaign.metrics)).astype(np.float64)
        flags = np.where(counted, broken, np.nan)
        name = limit_text({**entry, "of": requirement.metric_name})
        if MIN_EVENTS <= np.nansum(flags) <= np.sum(counted) - MIN_EVENTS:
            told.add(requirement.metric_name)
            events[f"violates {name}"] = flags
    for metric in select_key_metrics(campaign):
        if metric not in told:
            events |= _tail(metric, np.asarray(campaign.metrics[metric], np.float64))
    return {name: flags for name, flags in events.items() if _is_testable(flags)}


def _tail(metric: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """The worst tenth of the runs that have a metric."""
    label, known = metric_label(metric), np.isfinite(values)
    worse = -values if label.low_is_bad else values
    flags = (worse > np.quantile(worse[known], 1.0 - _TAIL)).astype(np.float64)
    side = "lowest" if label.low_is_bad else "highest"
    return {f"{side} tenth of {label.title[:1].lower()}{label.title[1:]}": np.where(known, flags, np.nan)}


def _is_testable(flags: np.ndarray) -> bool:
    count, runs = np.nansum(flags), np.sum(np.isfinite(flags))
    return bool(MIN_EVENTS <= count <= runs - MIN_EVENTS)


def table(found: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the table with cells of their small plots, the number of further ones, and a sentence."""
    rows = [_row(entry) for entry in found["drivers"][:_MOST_SHOWN]]
    return {"rows": rows, "more": max(0, len(found["drivers"]) - _MOST_SHOWN), "sentence": sentence(found)}


def sentence(found: Mapping[str, Any]) -> str:
    """How much was tested, and how many of the drivers may be false."""
    if not found["events"]:
        return "Nothing was tested: it takes independent runs, dispersed inputs, and events in some of the runs."
    count, tested = len(found["drivers"]), f"{len(found['events'])} events against {found['inputs']} inputs and pairs"
    if not count:
        return f"Of {tested}, none stands out from chance."
    return (
        f"{count} found among {tested}; of these at most about {100.0 * found['level']:g} % are expected to be false."
    )


def _row(entry: Mapping[str, Any]) -> dict[str, Any]:
    runs, count = np.array(entry["runs"]), np.array(entry["count"])
    rates = np.divide(count, runs, out=np.zeros(runs.shape), where=runs > 0)
    grid = rates.reshape(len(rates), -1)
    top = float(rates.max())
    low, high = float(rates[runs > 0].min()), top
    return {
        "event": entry["event"],
        "inputs": entry["inputs"],
        "q": "below 0.0001" if entry["q"] < 1e-4 else format_number(entry["q"], 2),
        "rates": f"{100.0 * low:.3g} to {100.0 * high:.3g} %",
        "parts": [" \N{MIDDLE DOT} ".join(_signed(value) for value in part) for part in entry["parts"]],
        "is_pair": len(entry["inputs"]) == 2,
        "cells": [
            {
                "x": row,
                "y": column,
                "height": float(value) / top if top else 0.0,
                "text": f"{100.0 * float(value):.3g} % of {int(runs.reshape(grid.shape)[row, column])} runs",
            }
            for row, line in enumerate(grid)
            for column, value in enumerate(line)
        ],
        "columns": grid.shape[0],
        "lines": grid.shape[1],
    }


def _signed(value: float) -> str:
    return format_number(value, 3).replace("-", "\N{MINUS SIGN}")
