"""What an estimate was asked for, read back from its folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from rpojax.analysis.reliability.simulated_failures.estimate_folder import CONFIGURATION_NAME, EstimateFolder
from rpojax.analysis.reliability.simulated_failures.estimate_options import EstimateSettings, FailureChoice
from rpojax.errors import ResultError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

_TYPES: dict[str, type] = {"scenario": dict, "failure": dict, "budget": int, "method": str, "seed": int}
_METHODS = get_args(get_type_hints(EstimateSettings)["method"])


@dataclass(frozen=True)
class RecordedEstimate:
    """What decides the bits of an estimate, besides the versions of the packages.

    Attributes:
        file: the scenario
        choice: which runs fail
        settings: budget and method
        seed: master seed of runs and of the estimate
    """

    file: ScenarioFile
    choice: FailureChoice
    settings: EstimateSettings
    seed: int


def read_estimate(directory: Path) -> RecordedEstimate:
    """What the estimate in a folder was asked for, finished or not.

    Raises:
        ResultError: the folder has no estimate, or one that is not as it was written.
        RpojaxError: its scenario is not one.
    """
    record = EstimateFolder(directory).read(CONFIGURATION_NAME)
    path = directory / CONFIGURATION_NAME
    for key, kind in _TYPES.items():
        if type(record.get(key)) is not kind:
            raise ResultError(f"{path}: found {record.get(key)!r:.60} as {key}, expected {kind.__name__}")
    if record["method"] not in _METHODS:
        raise ResultError(f"{path}: found method {record['method']!r:.60}, expected one of {', '.join(_METHODS)}")
    return RecordedEstimate(
        file=scenario_loader.validate_recorded(record["scenario"]),
        choice=_choice(path, record["failure"]),
        settings=EstimateSettings(budget=record["budget"], method=record["method"]),
        seed=record["seed"],
    )


def _choice(path: Path, failure: dict[str, Any]) -> FailureChoice:
    """The options that name a recorded failure."""
    outcome, metric, limit, bound = (failure.get(key) for key in ("outcome", "metric", "limit", "bound"))
    if isinstance(outcome, str) and metric is None:
        return FailureChoice(outcome=outcome)
    if not isinstance(metric, str) or not isinstance(bound, str) or type(limit) not in (int, float):
        raise ResultError(f"{path}: found failure {failure!r:.60}, expected an outcome, or a metric with its limit")
    if failure.get("required_probability") is not None:
        return FailureChoice(requirement=metric)
    return FailureChoice(metric=metric, limit=limit, bound=bound)
