"""Safety: smallest ranges, keep-out entries, passive safety, and longest times without an accepted box."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from rpojax.metrics.metric_catalogue import worst_first
from rpojax.metrics.passive_safety import STUCK_ON_RANGE, UNSAFE_FRACTION, horizon_metric_name
from rpojax.report.campaign_results import CampaignResults, keep_out_radii, probability_interval
from rpojax.report.labels import format_number, format_percent_interval, metric_label, with_unit
from rpojax.simulation.outcomes.outcome_kinds import Outcome
from rpojax.summary_text import counted


class SafetyRow(NamedTuple):
    """A row of the table: quantity, value, remark, and whether it is shown as a failure."""

    quantity: str
    value: str
    remark: str
    is_alert: bool = False


def content(campaign: CampaignResults) -> dict[str, Any]:
    """Part of report.json: smallest ranges, entries into the keep-out sphere, longest times without an accepted box.

    The smallest range includes the traces of failed runs up to their failure; for a run that entered the keep-out
    sphere it is at most the sphere's radius, and `at_most` marks that bound. Each servicer of a team
    has its own sphere. Proportions have exact 95 % intervals, None if runs are not independent.
    """
    entered = np.asarray(campaign.outcomes == Outcome.KEEP_OUT)
    keep_out = keep_out_radii(campaign)
    return {
        "keep_out_m": _radius_content(keep_out),
        "target_radius_m": _target_radius(campaign),
        "least_range": _least_range(campaign, keep_out, entered),
        "entries": {
            **_proportion(campaign, entered, np.ones(len(entered), dtype=bool)),
            "run_ids": campaign.run_ids[entered].tolist(),
        },
        "least_passive_range": _worst_value(campaign, "passive_range_m"),
        "passive_below_keep_out": _drifts_into_sphere(campaign, "passive_range_m", keep_out, entered),
        "free_drift": [
            {
                "horizon": horizon,
                "least_range": _worst_value(campaign, name),
                "below_keep_out": _drifts_into_sphere(campaign, name, keep_out, entered),
            }
            for horizon in campaign.info.get("scenario", {}).get("safety", {}).get("horizons", ())
            if (name := horizon_metric_name(horizon)) in campaign.metrics
        ],
        "unsafe_share": {
            "median": _median(campaign, UNSAFE_FRACTION),
            "worst": _worst_value(campaign, UNSAFE_FRACTION),
        },
        "stuck_on": {
            "least_range": _worst_value(campaign, STUCK_ON_RANGE),
            "below_keep_out": _range_violations(campaign, STUCK_ON_RANGE, keep_out, entered),
        },
        "longest_look_away": _worst_value(campaign, "look_away_peak_s"),
        "longest_unseen": _worst_value(campaign, "longest_unseen_s"),
    }


def nearest_text(safety: Mapping[str, Any], nearest: Mapping[str, Any] | None) -> str:
    """Nearest approach of a drift with its run, and whether it hits the target; empty without one."""
    if nearest is None:
        return ""
    radius = safety.get("target_radius_m")
    if radius is None or nearest["value"] >= radius:
        return f"nearest {with_unit(format_number(nearest['value'], 3), 'm')}, run {nearest['run_id']}"
    return f"nearest {nearest['value']:.3f} m, which hits the target, run {nearest['run_id']}"


def _target_radius(campaign: CampaignResults) -> float | None:
    """Radius [m] of the sphere about the target's origin that its nominal hull holds; None without a hull."""
    target = campaign.info.get("scenario", {}).get("target", {})
    if not target.get("hull_m"):
        return None
    hull = np.asarray(target["hull_m"], dtype=float) * float(target.get("scale", 1.0))
    return max(0.0, -float(ConvexHull(hull).equations[:, 3].max()))


def rows(safety: Mapping[str, Any]) -> list[SafetyRow]:
    """Rows of the table, those without a value left out."""
    keep_out = safety["keep_out_m"]
    sphere = "" if keep_out is None else f" of {_radius_text(keep_out)}"
    lines = [
        SafetyRow("Smallest range of any run", *worst_value_texts(safety["least_range"], "m")),
        _proportion_row(f"Runs that entered the keep-out sphere{sphere}", safety["entries"]),
        *_drift_rows(safety, sphere),
        SafetyRow("Longest look-away in a burn period", *worst_value_texts(safety["longest_look_away"], "s")),
        SafetyRow(metric_label("longest_unseen_s").title, *worst_value_texts(safety["longest_unseen"], "s")),
    ]
    return [line for line in lines if line.value]


def _drift_rows(safety: Mapping[str, Any], sphere: str) -> list[SafetyRow]:
    """Rows of free drift; campaigns recorded without horizons have rows of one orbit."""
    drifts = [
        (f"within {drift['horizon'].replace('_', ' ')} after a loss of thrust", drift) for drift in safety["free_drift"]
    ] or [
        (
            "after a loss of thrust",
            {"least_range": safety["least_passive_range"], "below_keep_out": safety["passive_below_keep_out"]},
        )
    ]
    drifts.append(("within 24 h after a burn that did not end", safety["stuck_on"]))
    lines = []
    for when, drift in drifts:
        lines.append(SafetyRow(f"Smallest range of free drift {when}", *worst_value_texts(drift["least_range"], "m")))
        title = f"Runs that could drift into the keep-out sphere{sphere} {when}"
        lines.append(_proportion_row(title, drift["below_keep_out"]))
    share = safety["unsafe_share"]
    if share["worst"] is not None:
        value, worst = (f"{100 * number:.3g} %" for number in (share["median"], share["worst"]["value"]))
        lines.append(
            SafetyRow(
                "Share of the time from which the longest drift enters the sphere, median run",
                value,
                f"at most {worst}, run {share['worst']['run_id']}",
                share["worst"]["value"] > 0.0,
            )
        )
    return lines


def _radius_content(radii: np.ndarray | None) -> float | list[float] | None:
    """Radius of the keep-out sphere, or the smallest and the largest where runs differ; None without one."""
    if radii is None:
        return None
    ends = [float(radii.min()), float(radii.max())]
    return ends[0] if ends[0] == ends[1] else ends


def _radius_text(radius: float | list[float]) -> str:
    if isinstance(radius, list):
        return f"{format_number(radius[0])} to {with_unit(format_number(radius[1]), 'm')}, each its own"
    return with_unit(format_number(radius), "m")


def _least_range(campaign: CampaignResults, keep_out: np.ndarray | None, entered: np.ndarray) -> dict[str, Any] | None:
    ranges = np.asarray(campaign.metrics.get("min_range_m", np.full(len(campaign.completed), np.nan)), dtype=np.float64)
    traced = campaign.traces.get("range_m")
    if traced is not None and traced.size:
        ranges = np.fmin(ranges, np.fmin.reduce(traced, axis=1))
    # Traces are coarse: their last sample may be well before the entry.
    radius = np.full(len(entered), np.inf) if keep_out is None else _radius_of_entry(campaign, keep_out)
    bounded = entered & np.isfinite(radius) & ~(ranges <= radius)
    ranges = np.where(bounded, radius, ranges).astype(np.float64)
    rows = worst_first("min_range_m", ranges)
    if not len(rows):
        return None
    row = rows[0]
    return {"value": float(ranges[row]), "run_id": int(campaign.run_ids[row]), "at_most": bool(bounded[row])}


def _worst_value(campaign: CampaignResults, name: str) -> dict[str, Any] | None:
    values = campaign.metrics.get(name)
    if values is None or not len(rows := worst_first(name, values)):
        return None
    return {"value": float(values[rows[0]]), "run_id": int(campaign.run_ids[rows[0]])}


def _drifts_into_sphere(
    campaign: CampaignResults, name: str, keep_out: np.ndarray | None, entered: np.ndarray
) -> dict[str, Any] | None:
    """Proportion of runs that enter the sphere or would drift into it, and the number of runs without a drift."""
    found = _range_violations(campaign, name, keep_out, entered)
    return None if found is None else {**found, "without_drift": len(entered) - found["runs"]}


def _range_violations(
    campaign: CampaignResults, name: str, keep_out: np.ndarray | None, entered: np.ndarray
) -> dict[str, Any] | None:
    """Proportion of runs that enter the sphere or would drift into it, among the runs for which this is known."""
    values = campaign.metrics.get(name)
    if values is None or keep_out is None:
        return None
    return _proportion(campaign, entered | _is_within(campaign, name, keep_out), entered | np.isfinite(values))


def _is_within(campaign: CampaignResults, name: str, keep_out: np.ndarray) -> np.ndarray:
    """Flags (runs,) of runs of which a range, of a team that of any servicer, is below the radius of its own sphere."""
    values = campaign.metrics[name]
    if not campaign.servicer_names:
        return np.asarray(values < keep_out)
    each = [campaign.metrics.get(f"{name}/{servicer}", values) for servicer in campaign.servicer_names]
    return np.asarray((np.stack(each, axis=-1) < keep_out).any(axis=-1))


def _radius_of_entry(campaign: CampaignResults, keep_out: np.ndarray) -> np.ndarray:
    """Radius (runs,) [m] of the keep-out sphere of the servicer that entered its sphere; the largest if none did."""
    runs = len(campaign.completed)
    if not campaign.servicer_names:
        return np.broadcast_to(keep_out, runs)
    own = np.broadcast_to(keep_out, (runs, keep_out.shape[-1]))
    has_entered = campaign.servicers("status")["failure"] == Outcome.KEEP_OUT.code
    found = np.min(own, axis=-1, where=has_entered, initial=np.inf)
    return np.where(has_entered.any(axis=-1), found, own.max(axis=-1))


def _median(campaign: CampaignResults, name: str) -> float | None:
    values = campaign.metrics.get(name)
    return None if values is None or not np.isfinite(values).any() else float(np.nanmedian(values))


def _proportion(campaign: CampaignResults, events: np.ndarray, known: np.ndarray) -> dict[str, Any]:
    count, total = int(np.sum(events & known)), int(np.sum(known))
    return {
        "count": count,
        "runs": total,
        "share": count / total if total else None,
        "interval_95": probability_interval(campaign, count, total),
    }


def worst_value_texts(found: Mapping[str, Any] | None, unit: str) -> tuple[str, str]:
    """Value with its unit and run; empty texts if there is no value."""
    if found is None:
        return "", ""
    bound = "at most " if found.get("at_most") else ""
    return bound + with_unit(format_number(found["value"]), unit), f"run {found['run_id']}"


def _proportion_row(title: str, found: Mapping[str, Any] | None) -> SafetyRow:
    """Row of a proportion of runs of which there should be none."""
    return SafetyRow(title, *_proportion_texts(found), found is not None and found["count"] > 0)


def _proportion_texts(found: Mapping[str, Any] | None) -> tuple[str, str]:
    if found is None or not found["runs"]:
        return "", ""
    value, interval = f"{found['count']} of {found['runs']}", found["interval_95"]
    if interval is None:
        return value, "runs are not independent: no interval" + without_drift_text(found)
    return value, f"95 % interval of the probability: {format_percent_interval(*interval)}{without_drift_text(found)}"


def without_drift_text(found: Mapping[str, Any]) -> str:
    """Addition of the runs that a proportion leaves out, since no drift of theirs is known; empty where it has all.

    A requirement on that drift counts them as violations, as it does all runs without a value.
    """
    count = found.get("without_drift")
    return f"; {counted(count, 'run')} without a drift not counted" if count else ""
