"""Paired comparison of two campaigns of the same runs: medians by bootstrap, events by McNemar's exact test."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import binomtest

from rpojax.analysis.statistics.intervals import resampled_medians
from rpojax.errors import ResultError
from rpojax.scenario.schema import RequirementSection
from rpojax.simulation.outcomes.outcome_kinds import Outcome, is_failed
from rpojax.simulation.outcomes.requirement_violations import counts, required_values, violates

_LEVELS = (0.90, 0.95)
MIN_PAIRS: Final = 10
"""With fewer pairs no interval is given, of a comparison and of a tuning."""


@dataclass(frozen=True)
class RunMetrics:
    """Compared part of a campaign: run ids (n,), outcomes (n,) as text, and metrics (n,), NaN where undefined."""

    run_ids: np.ndarray
    outcomes: np.ndarray
    metrics: Mapping[str, np.ndarray]

    @property
    def failed(self) -> np.ndarray:
        """(n,) whether the run failed."""
        return is_failed(self.outcomes)


@dataclass(frozen=True)
class PairedEvents:
    """Pairs of runs by which of the two campaigns has an event in them.

    Attributes:
        event: what is counted, such as a failure
        both: pairs with the event in both campaigns
        only_first: pairs with the event in the first alone
        only_second: pairs with the event in the second alone
        neither: pairs without it
        p_value: of so uneven a split of the pairs with one event, if the campaigns did not differ; None where runs
            are not independent
    """

    event: str
    both: int
    only_first: int
    only_second: int
    neither: int
    p_value: float | None


@dataclass(frozen=True)
class IntervalEstimate:
    """A number with its 90 % and 95 % intervals; None where it is undefined, or has too few independent runs."""

    value: float | None
    interval_90: tuple[float, float] | None
    interval_95: tuple[float, float] | None


@dataclass(frozen=True)
class MedianChange:
    """Change of the median of a metric over the pairs of runs that both have it.

    Attributes:
        metric: its name
        pairs: number of them
        first: median in the first campaign, NaN without pairs
        second: median in the second
        difference: second less first
        ratio: second over first, undefined for a metric with negative values
    """

    metric: str
    pairs: int
    first: float
    second: float
    difference: IntervalEstimate
    ratio: IntervalEstimate

    @property
    def is_changed(self) -> bool:
        """Whether the 95 % interval of the difference excludes no change."""
        ends = self.difference.interval_95
        return ends is not None and not ends[0] <= 0.0 <= ends[1]


@dataclass(frozen=True)
class PairedComparison:
    """Two campaigns compared over the runs that both have.

    Attributes:
        pairs: number of them
        unpaired: runs that only one of the campaigns has
        failures: runs that failed
        outcomes: runs that ended in each way other than completed, of those that occur
        requirements: violations of each requirement whose metric both have, in the order of the requirements
        metrics: that both have, in the order of the first
    """

    pairs: int
    unpaired: int
    failures: PairedEvents
    outcomes: tuple[PairedEvents, ...]
    requirements: tuple[PairedEvents, ...]
    metrics: tuple[MedianChange, ...]

    @property
    def few(self) -> int:
        """Number of metrics, without those of single servicers, with values in some pairs but too few for intervals."""
        return sum(0 < change.pairs < MIN_PAIRS and "/" not in change.metric for change in self.metrics)


def compare_paired_runs(
    first: RunMetrics,
    second: RunMetrics,
    requirements: Sequence[RequirementSection],
    independent: bool,
    seed: int = 0,
) -> PairedComparison:
    """Compares two campaigns by run id; with runs that are not independent there are no p-values and intervals.

    Requirements on a metric that only one campaign has are left out.

    Raises:
        ResultError: the campaigns have no run in common.
    """
    common, in_first, in_second = np.intersect1d(first.run_ids, second.run_ids, return_indices=True)
    if len(common) == 0:
        raise ResultError("run numbers: found none that both campaigns have, expected campaigns of the same runs")
    one, other = _rows(first, in_first), _rows(second, in_second)
    return PairedComparison(
        pairs=len(common),
        unpaired=len(first.run_ids) + len(second.run_ids) - 2 * len(common),
        failures=count_paired_events("failed", one.failed, other.failed, independent),
        outcomes=tuple(
            count_paired_events(str(kind), one.outcomes == kind, other.outcomes == kind, independent)
            for kind in Outcome
            if kind is not Outcome.COMPLETED and np.any((one.outcomes == kind) | (other.outcomes == kind))
        ),
        requirements=tuple(
            count_paired_events(
                f"not {requirement_name(requirement)}",
                _violating(requirement, one),
                _violating(requirement, other),
                independent,
            )
            for requirement in requirements
            if can_be_judged(requirement, one.metrics) and can_be_judged(requirement, other.metrics)
        ),
        metrics=_median_changes(one, other, np.random.default_rng(seed) if independent else None),
    )


def mcnemar_p(only_first: int, only_second: int) -> float:
    """Exact two-sided p-value of a split of the pairs in which only one of two has an event (McNemar, 1947)."""
    pairs = only_first + only_second
    return float(binomtest(only_first, pairs).pvalue) if pairs else 1.0


def count_paired_events(event: str, first: np.ndarray, second: np.ndarray, independent: bool) -> PairedEvents:
    """Counts an event by flags of pairs of runs, `first` (n,) and `second` (n,)."""
    only_first, only_second = int((first & ~second).sum()), int((~first & second).sum())
    return PairedEvents(
        event=event,
        both=int((first & second).sum()),
        only_first=only_first,
        only_second=only_second,
        neither=int((~first & ~second).sum()),
        p_value=mcnemar_p(only_first, only_second) if independent else None,
    )


def _rows(runs: RunMetrics, rows: np.ndarray) -> RunMetrics:
    metrics = {name: values[rows] for name, values in runs.metrics.items()}
    return RunMetrics(runs.run_ids[rows], runs.outcomes[rows], metrics)


def requirement_name(requirement: RequirementSection) -> str:
    """Metric, bound and limit of a requirement, and the outcome of the runs that count."""
    condition = "" if requirement.outcome is None else f" of {requirement.outcome} runs"
    condition += " of runs that reach it" if requirement.is_of_reaching_runs else ""
    return f"{requirement.metric_name} {requirement.bound} {requirement.limit:g}{condition}"


def can_be_judged(requirement: RequirementSection, metrics: Collection[str]) -> bool:
    """Whether the metrics of a campaign, by name, are those that a requirement is about."""
    window = requirement.window
    needed = {requirement.metric_name, *(() if requirement.phase is None else (window.presence_name,))}
    return needed <= set(metrics)


def _violating(requirement: RequirementSection, runs: RunMetrics) -> np.ndarray:
    values = required_values(requirement, runs.metrics)
    return violates(requirement, values) & counts(requirement, runs.metrics, runs.outcomes)


def _median_changes(one: RunMetrics, other: RunMetrics, rng: np.random.Generator | None) -> tuple[MedianChange, ...]:
    """Compares medians; no intervals without a generator. Metrics defined in the same pairs share their resamples."""
    names = [name for name in one.metrics if name in other.metrics]
    both = {name: np.isfinite(one.metrics[name]) & np.isfinite(other.metrics[name]) for name in names}
    groups: dict[bytes, list[str]] = {}
    for name in names:
        groups.setdefault(both[name].tobytes(), []).append(name)
    found: dict[str, MedianChange] = {}
    for group in groups.values():
        pairs = both[group[0]]
        columns = np.array([[runs.metrics[name][pairs] for name in group] for runs in (one, other)], dtype=np.float64)
        samples = np.zeros((*columns.shape[:2], 0))
        if rng is not None and pairs.sum() >= MIN_PAIRS:
            samples = resampled_medians(columns.reshape(-1, columns.shape[2]), rng).reshape(*columns.shape[:2], -1)
        found |= {name: _median_change(name, columns[:, i], samples[:, i]) for i, name in enumerate(group)}
    return tuple(found[name] for name in names)


def _median_change(name: str, values: np.ndarray, samples: np.ndarray) -> MedianChange:
    """Medians of `values` (2, n), with intervals from resampled ones (2, r)."""
    pairs = values.shape[1]
    if pairs == 0:
        return MedianChange(name, 0, np.nan, np.nan, *(IntervalEstimate(None, None, None),) * 2)
    first, second = map(float, np.median(values, axis=1))
    signed = bool((values < 0.0).any())
    ratio = None if first == 0.0 or signed else second / first
    # Where the median may be zero, the ratio has no interval.
    ratios = samples[1] / samples[0] if ratio is not None and (samples[0] != 0.0).all() else np.zeros(0)
    return MedianChange(
        metric=name,
        pairs=pairs,
        first=first,
        second=second,
        difference=_interval_estimate(second - first, samples[1] - samples[0]),
        ratio=_interval_estimate(ratio, ratios),
    )


def _interval_estimate(value: float | None, samples: np.ndarray) -> IntervalEstimate:
    """Percentile intervals: the jackknife of a median, which BCa needs, does not converge."""
    if len(samples) == 0:
        return IntervalEstimate(value, None, None)
    ends = [np.quantile(samples, [0.5 - 0.5 * level, 0.5 + 0.5 * level]) for level in _LEVELS]
    low_high = [(float(low), float(high)) for low, high in ends]
    return IntervalEstimate(value, *low_high)
