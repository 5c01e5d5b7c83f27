"""The result of an estimate, read back from its folder and checked before it is shown."""

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, FiniteFloat, ValidationError

from rpojax.analysis.reliability.simulated_failures.estimate_folder import RESULT_NAME, EstimateFolder
from rpojax.errors import ResultError


class _Failure(BaseModel):
    metric: str | None
    words: str


class _Requirement(BaseModel):
    allowed_probability_of_failure: FiniteFloat
    verdict: Literal["met", "violated", "open"]


class _Level(BaseModel):
    name: str
    evaluations: int
    probability: float | None
    threshold: float | None
    acceptance: float | None


class _PointDispersion(BaseModel):
    name: str
    sigmas: dict[str, float]
    values: dict[str, float | list[float]]
    nominal: dict[str, float | list[float]]


class _Point(BaseModel):
    distance_sigmas: FiniteFloat
    share: FiniteFloat
    dispersions: list[_PointDispersion]


class _RunDispersion(BaseModel):
    name: str
    sigmas: dict[str, float]


class _Run(BaseModel):
    distance_sigmas: FiniteFloat
    command: str
    dispersions: list[_RunDispersion]


class _Result(BaseModel):
    scenario: str
    scenario_hash: str
    seed: int
    probability: FiniteFloat
    interval_95: tuple[FiniteFloat, FiniteFloat]
    coefficient_of_variation: float | None
    evaluations: int
    method: str
    trusted: bool
    warnings: list[str]
    reason: str
    remark: str
    noise: str
    unmapped: list[str]
    plain_runs_for_equal_accuracy: float | None
    failure: _Failure
    requirement: _Requirement | None
    levels: list[_Level]
    design_points: list[_Point]
    failing_runs: list[_Run]


def read_result(directory: Path) -> dict[str, Any]:
    """Content of the result in a folder.

    Raises:
        ResultError: there is none, or it has not what a result has.
    """
    content = EstimateFolder(directory).read(RESULT_NAME)
    try:
        _Result.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(map(str, fault["loc"]))
        raise ResultError(
            f"{directory / RESULT_NAME}: found {key:.80}: {fault['msg']:.80}, expected a result"
        ) from None
    return content
