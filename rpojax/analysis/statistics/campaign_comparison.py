"""Comparison of two stored campaigns, run by run: changed scenario keys, medians, failures and requirements."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpojax.analysis.statistics.paired_comparison import (
    MIN_PAIRS,
    MedianChange,
    PairedComparison,
    PairedEvents,
    RunMetrics,
    can_be_judged,
    compare_paired_runs,
    requirement_name,
)
from rpojax.campaign import experiment_design
from rpojax.campaign.storage.atomic_outputs import to_json_types
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, RpojaxError
from rpojax.metrics import metric_catalogue
from rpojax.metrics.time_windows import split_name
from rpojax.optional_packages import require_package
from rpojax.runtime.progress import stage
from rpojax.scenario.schema import RequirementSection
from rpojax.summary_text import Summarised, Summary, counted, number, numbers

if TYPE_CHECKING:
    import pandas

_MAX_LISTED = 6
_KEY_METRICS = ("formation_error_rms_m", "nav_relative_position_error_rms_m", "delta_v_m_s", "min_range_m")
_SHOWN_ROWS = 6
"""Changed keys and metrics of a summary, each."""


@dataclass(frozen=True)
class KeyChange:
    """A scenario key whose value differs, with both values; None on a side that lacks it."""

    key: str
    first: Any
    second: Any


@dataclass(frozen=True, repr=False)
class CampaignComparison(Summarised):
    """Two campaigns compared over the runs that both have.

    Attributes:
        first: folder of the first campaign
        second: folder of the second campaign
        changed: keys of the two scenarios whose values differ
        independent: whether the runs are independent draws, so that there are intervals and p-values
        warnings: sentences on what makes the comparison less than one of like with like
        runs: medians, failures and violated requirements over the pairs of runs
    """

    first: Path
    second: Path
    changed: tuple[KeyChange, ...]
    independent: bool
    warnings: tuple[str, ...]
    runs: PairedComparison

    def to_dict(self) -> dict[str, Any]:
        """Content in the types of JSON, as `rpojax compare --json` prints it."""
        content = {
            "first": str(self.first),
            "second": str(self.second),
            "changed": [dataclasses.asdict(change) for change in self.changed],
            "independent": self.independent,
            "warnings": list(self.warnings),
        }
        return {**content, **to_json_types(dataclasses.asdict(self.runs))}

    def to_dataframe(self) -> "pandas.DataFrame":
        """One row a metric: pairs of runs, medians, their difference with its 95 % interval, ratio, and if it changed.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        rows = []
        for each in self.runs.metrics:
            low, high = each.difference.interval_95 or (None, None)
            rows.append(
                {"metric": each.metric, "pairs": each.pairs, "first": each.first, "second": each.second}
                | {"difference": each.difference.value, "difference_low_95": low, "difference_high_95": high}
                | {"ratio": each.ratio.value, "changed": each.is_changed}
            )
        return require_package("pandas").DataFrame(rows)

    def _summary(self) -> Summary:
        title = f"{self.first} -> {self.second}: {counted(self.runs.pairs, 'pair')} of runs"
        return Summary(title, [*self._changes(), *self._events(), *self._metrics(), *self._warnings()])

    def _changes(self) -> Iterator[tuple[str, str]]:
        for each in self.changed[:_SHOWN_ROWS]:
            yield "changed", f"{each.key}: {numbers(each.first)} -> {numbers(each.second)}"
        if (more := len(self.changed) - _SHOWN_ROWS) > 0:
            yield "changed", f"and {counted(more, 'further key')}"

    def _events(self) -> Iterator[tuple[str, str]]:
        """Failures, and the requirements that other numbers of runs violate."""
        yield "failed", self._counts(self.runs.failures)
        changed = [each for each in self.runs.requirements if each.only_first != each.only_second]
        for each in changed[:_SHOWN_ROWS]:
            yield "violated", f"{each.event}: {self._counts(each)}"
        if same := len(self.runs.requirements) - len(changed):
            yield "violated", f"{counted(same, 'requirement')} by as many runs in both"

    def _counts(self, event: PairedEvents) -> str:
        p = "" if event.p_value is None else f", p = {event.p_value:.2g}"
        return f"{event.both + event.only_first} -> {event.both + event.only_second} of {self.runs.pairs}{p}"

    def _metrics(self) -> Iterator[tuple[str, str]]:
        """Medians that differ, key metrics and then the largest relative change first."""
        found = [each for each in self.runs.metrics if each.is_changed and "/" not in each.metric]
        found.sort(key=lambda each: (each.metric not in _KEY_METRICS, -relative_change(each)))
        for each in found[:_SHOWN_ROWS]:
            low, high = each.difference.interval_95 or (None, None)
            unit = _unit(each.metric)
            medians = f"{numbers(each.first)} -> {numbers(each.second)} {unit}".strip()
            yield "medians", f"{each.metric}: {medians} (95 % of the difference {number(low)} to {number(high)})"
        if (more := len(found) - _SHOWN_ROWS) > 0:
            yield "medians", f"and {counted(more, 'further metric')} beyond chance"
        if not found:
            yield "medians", self._without_change()

    def _without_change(self) -> str:
        """Why no median is said to differ."""
        if not self.independent:
            return "no intervals: dependent draws"
        if all(each.difference.interval_95 is None for each in self.runs.metrics):
            return f"no intervals: they need {MIN_PAIRS} pairs of runs with a value"
        return "none differs beyond chance"

    def _warnings(self) -> Iterator[tuple[str, str]]:
        yield from (("warning", each) for each in self.warnings)


def _unit(metric: str) -> str:
    """Unit of a metric, empty where it has none, or where plugins of this process define it differently."""
    try:
        return metric_catalogue.unit_of(metric).replace("-", "")
    except RpojaxError:
        return ""


def compare(first: Campaign, second: Campaign, *, progress: bool = True) -> CampaignComparison:
    """Compares two campaigns of the same seed by run id: run n has the same dispersions in both.

    Args:
        first: campaign to compare with
        second: campaign that is compared with it
        progress: show on stderr that the comparison is under way

    Raises:
        ResultError: runs of one id are not the same case in both, or the campaigns have no run in common.
    """
    _check_paired(first, second)
    designs = experiment_design
    independent = designs.has_independent_runs(first.file) and designs.has_independent_runs(second.file)
    differing = defined_differently(first.info, second.info)
    runs = [RunMetrics(each.run_ids, each.outcomes, without(each.metrics, differing)) for each in (first, second)]
    with stage("comparing runs", quiet=not progress):
        compared = compare_paired_runs(runs[0], runs[1], _requirements(first, second, differing), independent)
    changed = changed_keys(first.info["scenario"], second.info["scenario"])
    warnings = comparison_warnings(first, second)
    return CampaignComparison(first.directory, second.directory, changed, independent, warnings, compared)


def relative_change(change: MedianChange) -> float:
    """Size of the change of a median over the sum of the sizes of both medians: 0 for none, 1 for a change of sign."""
    size = abs(change.first) + abs(change.second)
    return abs(change.second - change.first) / size if size > 0.0 else 0.0


def comparison_warnings(first: Campaign, second: Campaign) -> tuple[str, ...]:
    """Sentences on differences that make the two campaigns hard to compare.

    They name durations and teams that differ, and metrics and requirements that only one campaign has values for.
    """
    found = []
    durations = [each.info["scenario"].get("duration_s") for each in (first, second)]
    if durations[0] != durations[1]:
        found.append(
            f"durations differ, {durations[0]:g} s and {durations[1]:g} s: totals, peaks and the time windows of means "
            "are not those of the same span"
        )
    found += servicer_warnings(first.metrics, second.metrics)
    differing = defined_differently(first.info, second.info)
    if differing:
        found.append(f"metrics that plugins define differently are not compared: {', '.join(differing)}")
    for here, there in ((first, second), (second, first)):
        alone = sorted(name for name in here.metrics if name not in there.metrics and "/" not in name)
        if alone:
            more = f" and {len(alone) - _MAX_LISTED} more" if len(alone) > _MAX_LISTED else ""
            listed = ", ".join(alone[:_MAX_LISTED]) + more
            found.append(f"{there.directory} lacks metrics of {here.directory}, which are not compared: {listed}")
        unjudged = [each for each in _requirements(first, second, differing) if not can_be_judged(each, there.metrics)]
        if unjudged:
            listed = ", ".join(map(requirement_name, unjudged))
            found.append(f"{there.directory} has no values for requirements, which are not compared: {listed}")
    return tuple(found)


def servicer_warnings(first: Iterable[str], second: Iterable[str]) -> list[str]:
    """A sentence on servicers that only one of two campaigns has, from the names of their metrics."""
    teams = [sorted({name.partition("/")[2] for name in names if "/" in name}) for names in (first, second)]
    if teams[0] == teams[1]:
        return []
    one, other = (", ".join(team) or "one without a name" for team in teams)
    return [
        f"servicers differ, {one} against {other}: numbers of a team are over other servicers, and those of a servicer "
        "that one campaign lacks are not compared"
    ]


def changed_keys(first: Any, second: Any, path: str = "") -> tuple[KeyChange, ...]:
    """Keys of two scenarios, as nested tables, whose values differ."""
    if isinstance(first, dict) and isinstance(second, dict):
        keys = [*first, *(key for key in second if key not in first)]
        return tuple(
            each
            for key in keys
            for each in changed_keys(first.get(key), second.get(key), f"{path}.{key}" if path else str(key))
        )
    return () if first == second else (KeyChange(path, first, second),)


def _check_paired(first: Campaign, second: Campaign) -> None:
    """Refuses campaigns whose runs of one id are not the same case."""
    found, expected = second.info["seed"], first.info["seed"]
    if found != expected:
        raise ResultError(f"{second.directory}: found seed {found}, expected {expected}, that of {first.directory}")
    teams = [sorted(each.servicer_names) for each in (first, second)]
    if teams[0] != teams[1] and not set(teams[0]) & set(teams[1]):
        there, here = (", ".join(team) or "one without a name" for team in teams)
        raise ResultError(
            f"{second.directory}: found the servicers {here}, expected any of {first.directory} ({there}): "
            "run n of the one is not run n of the other"
        )
    _, in_first, in_second = np.intersect1d(first.run_ids, second.run_ids, return_indices=True)
    drawn = first.drawn, second.drawn
    for key in drawn[0].keys() & drawn[1].keys():
        values = drawn[0][key][in_first], drawn[1][key][in_second]
        if values[0].shape != values[1].shape or not np.array_equal(*values, equal_nan=True):
            raise ResultError(
                f"{second.directory}: found other values drawn for {key!r}, expected those of {first.directory}, "
                "so that runs of one number can be compared"
            )


def defined_differently(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[str]:
    """Metrics of plugins that two campaigns define differently, from the contents of their `campaign.json`.

    A campaign of a version that recorded no digests of metrics has that of its whole plugin.
    """
    metrics = [(each.get("plugin") or {}).get("metrics") or {} for each in (first, second)]
    same_plugin = first["scenario"].get("plugin_sha256") == second["scenario"].get("plugin_sha256")
    return [
        name
        for name, one in metrics[0].items()
        if (other := metrics[1].get(name)) is not None and not same_plugin and (one != other or "sha256" not in one)
    ]


def without(metrics: Mapping[str, np.ndarray], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Metrics but those of some names, in windows and of servicers too."""
    return {name: values for name, values in metrics.items() if _base(name) not in names}


def _base(name: str) -> str:
    return split_name(name.partition("/")[0])[0]


def _requirements(first: Campaign, second: Campaign, differing: Sequence[str]) -> list[RequirementSection]:
    """Requirements of either campaign, each once, but those on metrics that they define differently."""
    listed = [each for each in (*first.requirements, *second.requirements) if each.metric not in differing]
    return [item for index, item in enumerate(listed) if item not in listed[:index]]
