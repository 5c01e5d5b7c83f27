"""Which failure a probability is of, by the options of an estimate."""

from dataclasses import dataclass
from typing import Any

from rpojax.analysis.reliability.metric_limit import with_one_limit
from rpojax.analysis.reliability.simulated_failures.estimate_options import Bound, FailureChoice
from rpojax.errors import RpojaxError
from rpojax.metrics import metric_catalogue
from rpojax.scenario.phases.phase_sections import NO_GOAL
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.simulation.outcomes.outcome_kinds import Outcome


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
    default: Bound = "at least" if metric is not None and metric.low_is_bad else "at most"
    if choice.bound not in (None, "at most", "at least"):
        raise RpojaxError.of_argument("bound", f"found {choice.bound!r}, expected 'at most' or 'at least'")
    bound: Bound = default if choice.bound is None else "at most" if choice.bound == "at most" else "at least"
    return Failure(choice.metric, bound, choice.limit)


def _of_outcome(file: ScenarioFile, name: str) -> Failure:
    """Failure with an outcome; one with which no run can end, whose probability would be zero, is refused."""
    reach, is_mission = DispersedReach(file), bool(file.phases)
    possible = {
        Outcome.UNFINISHED: is_mission and file.goal.phase != NO_GOAL,
        Outcome.ABORTED: is_mission,
        Outcome.LOST: reach.low("limits.lost_after_s") <= file.duration_s,
        Outcome.OFF_STATION: reach.low("limits.arrive_by_s") <= file.duration_s,
    }
    known = [str(each) for each in Outcome if each.is_failure and possible.get(each, True)]
    if name not in known:
        found = f"{name!r} in runs of {file.duration_s:g} s"
        raise RpojaxError.of_argument("outcome", f"found {found}, expected one that can occur: {', '.join(known)}")
    return Failure(outcome=Outcome(name))


def _of_requirement(file: ScenarioFile, name: str) -> Failure:
    of_runs = [each for each in file.requirements if each.is_of_all_runs]
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
    if name in own or (metric is not None and metric.source in ("records", "drifts") and "," not in name):
        return
    known = [each for each, metric in metric_catalogue.METRICS.items() if metric.source in ("records", "drifts")]
    raise RpojaxError.of_argument("metric", f"found {name!r}, expected one of {', '.join([*known, *own])}")
