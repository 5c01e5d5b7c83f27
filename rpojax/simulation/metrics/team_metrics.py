"""Metrics of a team's run from those of its servicers, and from their channels."""

from collections.abc import Mapping
from itertools import combinations
from typing import Literal

import numpy as np

from rpojax.metrics import passive_safety, team
from rpojax.metrics.metric_definition import Floats, Metric
from rpojax.metrics.record_statistics import (
    lag_1_autocorrelation,
    longest_streak,
    longest_total_between_decisions,
    longest_wait,
    time_to_first,
)
from rpojax.metrics.time_windows import DURATION, EVENT_TIME, split_name

_LONGEST = (longest_streak, longest_wait, longest_total_between_decisions)
_OF_ONE_INSTANT = ("end", time_to_first)
"""Reductions that are the value at, or the time of, one instant."""

TEAM_CHANNELS = ("news_used", "burn_changed_for")
"""Channels that only teams have, and that are recorded of every run."""


def joined(metric: Metric | None, each: Floats) -> Floats:
    """Metric of the team (runs,) from those of its servicers (runs, servicers).

    Least values of a run give the least one, greatest and longest ones and unsafe fractions the greatest. Values at one
    instant, such as the last range or the time of the first box, give their worst one, and so does a user's function of
    whole runs, which may be anything. Means, sums and counts of a run give their mean. A metric
    that is undefined for one servicer is undefined for the team: a servicer that never saw the target must not be
    hidden by the times of the others. Only of events that need not happen, and of free drifts, the defined values
    count: without a burn, no thruster is stuck on. How long, or when, a team was in a phase is decided by its last
    servicer to come there: a team is in a phase if all its servicers are.
    """
    window = None if metric is None else split_name(metric.name)[0]
    if window == DURATION.name:
        return np.min(each, axis=1)
    if window == EVENT_TIME.name:
        return np.max(each, axis=1)
    defined = np.isfinite(each)
    may_be_none = metric is not None and (metric.of_events or metric.source == "drifts")
    known = defined.any(axis=1) if may_be_none else defined.all(axis=1)
    match _extreme(metric):
        case "least":
            found = np.min(each, axis=1, where=defined, initial=np.inf)
        case "greatest":
            found = np.max(each, axis=1, where=defined, initial=-np.inf)
        case _:
            found = np.sum(each, axis=1, where=defined, dtype=float) / np.maximum(defined.sum(axis=1), 1)
    return np.where(known, found, np.nan)


def _extreme(metric: Metric | None) -> Literal["least", "greatest"] | None:
    """Which of its servicers' values is that of a team; none of them where it is their mean."""
    if metric is None:
        return None
    if metric.reduction in ("min", "max"):
        return "least" if metric.reduction == "min" else "greatest"
    is_of_user = metric.source == "plugin" and metric.reduction is not lag_1_autocorrelation
    is_of_whole_runs = is_of_user and callable(metric.reduction)
    if is_of_whole_runs or metric.reduction in _OF_ONE_INSTANT or (metric.source == "drifts" and metric.low_is_bad):
        return "least" if metric.low_is_bad else "greatest"
    is_longest = metric.reduction in _LONGEST
    return "greatest" if is_longest or metric.name == passive_safety.UNSAFE_FRACTION else None


def evaluate(tick_s: float, records: Mapping[str, np.ndarray]) -> dict[str, Floats]:
    """Metrics of the team (runs,) from channels (runs, ticks, ..., servicers) at ticks of `tick_s` [s]."""
    found = {team.SEPARATION: _least_separation(records["rho_H"]), team.UNSEEN: _unseen(records, tick_s)}
    if "news_used" in records:
        used = records["news_used"]
        found[team.DELIVERY] = used.mean(axis=tuple(range(1, used.ndim)))
    if "burn_changed_for" in records:
        changed = records["burn_changed_for"] > 0
        found[team.CHANGED_BURNS] = changed.sum(axis=tuple(range(1, changed.ndim))).astype(float)
    return found


def _least_separation(rho_H: np.ndarray) -> Floats:
    """Least distance between any two servicers (runs,) [m]; NaN for one alone."""
    pairs = [
        np.linalg.norm(rho_H[..., i].astype(float) - rho_H[..., j], axis=2).min(axis=1)
        for i, j in combinations(range(rho_H.shape[-1]), 2)
    ]
    return np.min(pairs, axis=0) if pairs else np.full(len(rho_H), np.nan)


def _unseen(records: Mapping[str, np.ndarray], tick_s: float) -> Floats:
    """Longest time in which nobody accepts a box of the target, after the first one (runs,) [s]."""
    seen = np.asarray((records["box_accepted"] & ~records["box_outlier"]).any(axis=-1), dtype=bool)
    tick = np.arange(seen.shape[1])
    last = np.maximum.accumulate(np.where(seen, tick, -1), axis=1)
    gap = np.where(last >= 0, tick - last, 0)
    return np.where(np.any(seen, axis=1), gap.max(axis=1) * tick_s, np.nan)
