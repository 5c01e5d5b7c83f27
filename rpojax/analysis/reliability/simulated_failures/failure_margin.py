"""Margin of a run to a failure: as continuous as it can be, at or below zero exactly for failures.

A metric's margin is its distance from the limit. An outcome has that of the quantity that decides it, such as the least
range for keep-out. A count, which is equal for most runs, is ranked by the continuous metric nearest to it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.analysis.reliability.search_settings import Bound, FailureChoice
from rpojax.analysis.reliability.simulated_limit_state import side, with_one_limit
from rpojax.errors import RpojaxError
from rpojax.flight.mission.static_mission_settings import BUILT_IN_PHASES
from rpojax.metrics import metric_catalogue
from rpojax.metrics.metric_definition import Metric
from rpojax.scenario import metric_needs
from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.phases.phase_sections import NO_GOAL
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.simulation.metrics import mission_goal, recorded_metrics
from rpojax.simulation.outcomes.judgement import DIVERGED_NEES, LEAST_COVERAGE, JudgedRuns
from rpojax.simulation.outcomes.outcome_kinds import Outcome

Arrays = Mapping[str, np.ndarray]
LEAST = 1e-9
"""Size of a margin that only tells failure from success."""
_RANKED_BY: Final = {
    "passive_unsafe_fraction": "passive_range_24_h_m",
    "boxes_rejected": "nav_relative_position_error_rms_m",
    "outage_count": "outage_longest_s",
}
"""Metrics that are equal for most runs, and continuous ones that come near failure with them."""


@dataclass(frozen=True)
class Failure:
    """The failure of a run.

    Attributes:
        metric: whose limit it breaks; None for an outcome
        bound: side of the limit on which the metric must stay
        limit: in the unit of the metric
        outcome: with which it ends; None for a metric
        required_probability: least probability of success that the scenario asks for; None without a requirement
    """

    metric: str | None = None
    bound: Bound = "at most"
    limit: float = 0.0
    outcome: Outcome | None = None
    required_probability: float | None = None

    @property
    def words(self) -> str:
        """The failure in words."""
        if self.outcome is not None:
            return f"outcome {self.outcome}"
        side = "above" if self.bound == "at most" else "below"
        assert self.metric is not None
        unit = metric_catalogue.unit_of(self.metric)
        limit = f"{self.limit:g}{'' if unit == '-' else f' {unit}'}"
        return f"{self.metric} {side} {limit}, or undefined, as in a run that ended early"

    def to_record(self) -> dict[str, Any]:
        """Content for JSON."""
        return {**vars(self), "outcome": None if self.outcome is None else str(self.outcome), "words": self.words}


def choose_failure(file: ScenarioFile, choice: FailureChoice) -> Failure:
    """The failure that options name.

    Raises:
        RpojaxError: naming the argument.
    """
    named = [name for name in ("requirement", "metric", "outcome") if getattr(choice, name) is not None]
    if len(named) != 1:
        found = " and ".join(named) or "none"
        raise RpojaxError.of_argument("requirement, metric, outcome", f"found {found}, expected one of the three")
    if choice.metric is None and choice.limit is not None:
        raise RpojaxError.of_argument("limit", f"found {choice.limit:g}, expected it with metric only")
    if choice.metric is None and choice.bound is not None:
        raise RpojaxError.of_argument("bound", f"found {choice.bound!r}, expected it with metric only")
    if choice.outcome is not None:
        return _of_outcome(file, choice.outcome)
    if choice.requirement is not None:
        return _of_requirement(file, choice.requirement)
    assert choice.metric is not None
    _check_metric(file, choice.metric)
    if choice.limit is None or not -1e300 < choice.limit < 1e300:
        raise RpojaxError.of_argument("limit", f"found {choice.limit}, expected a number, with metric")
    metric = metric_catalogue.find(choice.metric)
    return Failure(choice.metric, side(choice.bound, metric is not None and metric.low_is_bad), choice.limit)


def _of_outcome(file: ScenarioFile, name: str) -> Failure:
    """Failure with an outcome; refuses an outcome that no run can have, since its probability would be zero."""
    reach, is_mission = DispersedReach(file), bool(file.phases)
    possible = {
        Outcome.UNFINISHED: is_mission and file.goal.phase != NO_GOAL,
        Outcome.ABORTED: is_mission and file.goal.phase != BUILT_IN_PHASES[-1],
        Outcome.LOST: reach.low("limits.lost_after_s") <= file.duration_s,
        Outcome.OFF_STATION: reach.low("limits.arrive_by_s") <= file.duration_s,
    }
    known = [str(outcome) for outcome in Outcome if outcome.is_failure and possible.get(outcome, True)]
    if name not in known:
        found = f"{name!r} in runs of {file.duration_s:g} s"
        raise RpojaxError.of_argument("outcome", f"found {found}, expected one that can occur: {', '.join(known)}")
    return Failure(outcome=Outcome(name))


def _of_requirement(file: ScenarioFile, name: str) -> Failure:
    of_runs = [requirement for requirement in file.requirements if requirement.is_of_all_runs]
    chosen = [each for each in of_runs if each.metric == name]
    if not chosen:
        known = ", ".join(each.metric for each in of_runs) or "none"
        expected = f"the metric of a requirement on whole runs of the scenario ({known})"
        raise RpojaxError.of_argument("requirement", f"found {name!r}, expected {expected}")
    _check_metric(file, name)
    one = with_one_limit(chosen)
    return Failure(name, one.bound, one.limit, None, one.probability)


def _check_metric(file: ScenarioFile, name: str) -> None:
    """Refuses metrics that runs of the scenario do not have."""
    own = plugin_registry.metrics_of(file)
    metric = metric_catalogue.find(name)
    if name in own or (_is_of_runs(file, metric) and "," not in name):
        return
    known = [each for each, metric in metric_catalogue.METRICS.items() if _is_of_runs(file, metric)]
    raise RpojaxError.of_argument("metric", f"found {name!r}, expected one of {', '.join([*known, *own])}")


def _is_of_runs(file: ScenarioFile, metric: Metric | None) -> bool:
    """Whether it is evaluated from records or drifts of the runs of the scenario."""
    if metric is None or metric.source not in ("records", "drifts"):
        return False
    return metric_needs.lacks(file, metric) is None


@dataclass(frozen=True)
class SimulatedRuns:
    """What a margin is computed from.

    Attributes:
        file: the scenario
        records: recorded channels (runs, ticks, ...)
        used: values of the runs (runs, ...) by key, of the keys that vary
        drifts: metrics (runs,) of free drifts; empty if they were not needed
        judged: how the runs ended
    """

    file: ScenarioFile
    records: Arrays
    used: Arrays
    drifts: Arrays
    judged: JudgedRuns


def needs_drifts(failure: Failure) -> bool:
    """Whether the margin needs the free drifts of runs."""
    names = (failure.metric or "", _RANKED_BY.get(failure.metric or "", ""))
    return any(name.startswith(("passive_", "stuck_on_", "final_drift_")) for name in names)


def ranking_remark(failure: Failure) -> str:
    """Remark on the metric that ranks the runs if the limited metric is equal in most of them; else empty."""
    by = _RANKED_BY.get(failure.metric or "")
    return f"{failure.metric} is equal for most runs and cannot rank them: {by} does" if by else ""


def margins(runs: SimulatedRuns, failure: Failure) -> np.ndarray:
    """Margins (runs,), NaN where the metric is undefined though the run was completed."""
    if failure.outcome is not None:
        failed = runs.judged.codes == failure.outcome.code
        return _with_sign(_outcome_distance(runs, failure.outcome), failed)
    assert failure.metric is not None
    values = _metric(runs, failure.metric)
    room = failure.limit - values if failure.bound == "at most" else values - failure.limit
    # A value at the limit keeps it.
    found = np.where(room >= 0.0, np.maximum(room, LEAST), room)
    by = _RANKED_BY.get(failure.metric)
    if by is not None:
        ranking = _metric(runs, by)
        rank = 1.0 / (1.0 + np.maximum(ranking, 0.0)) if by not in runs.drifts else np.maximum(ranking, 0.0)
        found = np.where(found > 0.0, np.nan_to_num(rank, nan=1.0) + LEAST, found)
    return np.where(runs.judged.frozen, -LEAST, found)


def values(runs: SimulatedRuns, failure: Failure) -> np.ndarray:
    """Values (runs,) that are reported of runs: of the metric, or of the distance that decides the outcome."""
    if failure.metric is not None:
        return _metric(runs, failure.metric)
    assert failure.outcome is not None
    return _outcome_distance(runs, failure.outcome)


def _metric(runs: SimulatedRuns, name: str) -> np.ndarray:
    if name in runs.drifts:
        return runs.drifts[name]
    with np.errstate(invalid="ignore"):
        return np.asarray(recorded_metrics.evaluate(runs.file, runs.records, runs.used)[name], dtype=np.float64)


def _with_sign(distance: np.ndarray, failed: np.ndarray) -> np.ndarray:
    """Distances (runs,) made negative for failures and positive for others."""
    defined = np.nan_to_num(distance, nan=LEAST)
    return np.where(failed, np.minimum(defined, -LEAST), np.maximum(defined, LEAST))


def _outcome_distance(runs: SimulatedRuns, outcome: Outcome) -> np.ndarray:
    """Distance (runs,) from an outcome, in the unit of the quantity that decides it; constant if none does."""
    file, records, used = runs.file, runs.records, runs.used
    tick_s = 1.0 / file.rates.camera_hz

    def limit(section: str, name: str) -> np.ndarray:
        return values_of_runs(used, f"{section}.{name}", getattr(getattr(file, section), name))

    rho = records["rho_H"]
    if outcome is Outcome.KEEP_OUT:
        return np.linalg.norm(rho, axis=2).min(axis=1) - limit("limits", "keep_out_m")
    if outcome is Outcome.OUT_OF_PROPELLANT:
        return limit("limits", "propellant_kg") - records["propellant_used_kg"][:, -1]
    if outcome is Outcome.OFF_STATION:
        desired = recorded_metrics.desired_position_H(file, records, used)
        return limit("limits", "off_station_m") - np.linalg.norm(rho - desired, axis=2)[:, -1]
    if outcome is Outcome.LOST:
        seen = records["box_accepted"] & ~records["box_outlier"]
        return limit("limits", "lost_after_s") - tick_s * _ticks_since(seen, records["observable"])
    if outcome is Outcome.DIVERGED:
        nees = np.maximum(records["nees_relative"][:, -1], 1e-12)
        coverage = 1.0 - recorded_metrics.outside_sigmas(records).mean(axis=(1, 2))
        return np.minimum(np.log(DIVERGED_NEES / nees), (coverage - LEAST_COVERAGE) / (1.0 - LEAST_COVERAGE))
    if outcome is Outcome.UNFINISHED:
        left = records["running"].shape[1] * tick_s - mission_goal.reached_at_s(file, records)
        return np.nan_to_num(left, nan=-LEAST)
    return np.ones(len(rho))


def _ticks_since(events: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Number (runs,) of `counted` ticks (runs, ticks) after the last tick with an event."""
    since_end = np.cumsum((counted & ~events)[:, ::-1], axis=1)
    any_event = events.any(axis=1)
    last = np.argmax(events[:, ::-1], axis=1)
    ended = np.take_along_axis(since_end, np.maximum(last - 1, 0)[:, None], axis=1)[:, 0]
    return np.where(any_event, np.where(last == 0, 0, ended), since_end[:, -1])
